"""The certificate of a load-cell calibration as a digital calibration certificate (DCC 3.3.0 of the PTB), in XML.

A DCC must name laboratory, country, customer and person. They are what the run says about itself by the keys
`laboratory`, `country` (two letters), `customer` and `operator`. What it does not say is "not recorded", or country ZZ,
which no country has: then the certificate is well formed, and the rules of the PTB refuse it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from palpate.instrument.uncertainty.budget import COVERAGE
from palpate.procedures.console.terminal import clean
from palpate.procedures.records.run import Run
from palpate.procedures.showing.text import STAMP

NAMESPACES = {"xmlns:dcc": "https://ptb.de/dcc", "xmlns:si": "https://ptb.de/si", "schemaVersion": "3.3.0"}
UNKNOWN, NOWHERE = "not recorded", "ZZ"  # ISO 3166 leaves ZZ to its users
UNITS = {
    "N": r"\newton",
    "mV": r"\milli\volt",
    "mV/N": r"\milli\volt\newton\tothe{-1}",
    "mV/N²": r"\milli\volt\newton\tothe{-2}",
}  # of the SI as a DCC writes them
NORMS = ("ISO 376", "ASTM E74")
IN_WORDS = ("Settings", "Conditions", "Classification", "Validity")  # sections that it tells in words
NamesAndTexts = Iterable[tuple[str, str]]  # names and texts


@dataclass(frozen=True, slots=True)
class CertifiedQuantity:
    """A result of a calibration: its value and standard uncertainty in `unit`, and its coverage factor."""

    name: str
    value: float
    u: float
    k: float
    unit: str

    @property
    def expanded(self) -> float:
        return self.k * self.u


def dcc(run: Run, device: str, quantities: Sequence[CertifiedQuantity], texts: Mapping[str, NamesAndTexts]) -> str:
    """The certificate as XML.

    Args:
        run: the run, with its points.
        device: serial number of the load cell with its indicator.
        quantities: the results with their uncertainties.
        texts: names and texts of the sections `IN_WORDS`.
    """
    serials: Any = run.header["devices"]
    settings = "; ".join(f"{name}: {text}" for name, text in texts["Settings"])
    readings = (_column(run, *column) for column in (("load", "load_N", "N"), ("mean reading", "reading_mV", "mV")))
    result = _e(
        "measurementResult",
        _text("name", "Calibration of a load cell with dead weights"),
        _e("usedMethods", _e("usedMethod", _text("name", "dead weights up and down, least squares"),
            _text("description", settings), *(_e("norm", norm) for norm in NORMS))),
        _e("measuringEquipments", *(
            _e("measuringEquipment", _text("name", name), _serial(serial)) for name, serial in serials.items()
        )),
        _e("influenceConditions", *(
            _e("influenceCondition", _text("name", name), _e("data", _text("text", text)))
            for name, text in texts["Conditions"]
        )),
        _e("results", *map(_quantity, quantities), _result("readings", _e("list", *readings)),
            *(_result(name, _text("text", text)) for name, text in texts["Classification"])),
    )  # fmt: skip
    root = _e(
        "digitalCalibrationCertificate",
        _administrative(run, device, texts["Validity"]),
        _e("measurementResults", result),
        **NAMESPACES,
    )
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=False) + "\n"


def _administrative(run: Run, device: str, validity: NamesAndTexts) -> Element:
    versions: Any = run.header["versions"]
    about, country = run.about, run.about.get("country", "")
    country = country if re.fullmatch("[A-Z]{2}", country) else NOWHERE
    ended = run.started + timedelta(microseconds=max((point["bench_ns"] for point in run.points()), default=0) // 1000)
    stamp = [(STAMP, "no real load cell was calibrated; this certificate is worth nothing")] if run.simulated else []
    laboratory = _contact(about.get("laboratory"), _e("countryCode", country))
    return _e(
        "administrativeData",
        _e("dccSoftware", _e("software", _text("name", "palpate"), _e("release", f"v{versions['palpate']}"))),
        _e(
            "coreData",
            _e("countryCodeISO3166_1", country),
            _e("usedLangCodeISO639_1", "en"),
            _e("mandatoryLangCodeISO639_1", "en"),
            _e("uniqueIdentifier", f"{run.folder.name} {run.digest()}"),
            _e("beginPerformanceDate", run.started.date().isoformat()),
            _e("endPerformanceDate", ended.date().isoformat()),
            _e("performanceLocation", "laboratory"),
        ),
        _e("items", _e("item", _text("name", "load cell with indicator"), _serial(device))),
        _e("calibrationLaboratory", _e("contact", *laboratory)),
        _e("respPersons", _e("respPerson", _e("person", _text("name", about.get("operator", UNKNOWN))))),
        _e("customer", *_contact(about.get("customer"), _text("further", UNKNOWN))),
        _e("statements", *(
            _e("statement", _text("name", name), _text("declaration", text))
            for name, text in (*stamp, *validity, *about.items())
        )),
    )  # fmt: skip


def _quantity(of: CertifiedQuantity) -> Element:
    expanded = _e(
        "si:expandedMU",
        _e("si:valueExpandedMU", repr(float(of.expanded))),
        _e("si:coverageFactor", repr(float(of.k))),
        _e("si:coverageProbability", repr(COVERAGE)),
    )
    value, unit = _e("si:value", repr(float(of.value))), _e("si:unit", UNITS[of.unit])
    real = _e("si:real", value, unit, _e("si:measurementUncertaintyUnivariate", expanded))
    return _result(of.name, _e("quantity", real))


def _column(run: Run, name: str, key: str, unit: str) -> Element:
    values = _e("si:valueXMLList", " ".join(repr(float(point[key])) for point in run.points()))
    return _e("quantity", _text("name", name), _e("si:realListXMLList", values, _e("si:unitXMLList", UNITS[unit])))


def _result(name: str, data: Element) -> Element:
    return _e("result", _text("name", name), _e("data", data))


def _contact(name: str | None, place: Element) -> tuple[Element, Element]:
    return _text("name", name or UNKNOWN), _e("location", place)


def _serial(serial: str) -> Element:
    return _e("identifications", _e("identification", _e("issuer", "manufacturer"), _e("value", serial)))


def _text(name: str, text: str) -> Element:
    return _e(name, _e("content", clean(text), lang="en"))


def _e(name: str, *inner: Element | str, **attributes: str) -> Element:
    """An element, of the namespace dcc if its name tells none, with elements or a text inside."""
    element = Element(name if ":" in name else f"dcc:{name}", attributes)
    for each in inner:
        if isinstance(each, str):
            element.text = " ".join(clean(each).split()) or UNKNOWN
        else:
            element.append(each)
    return element
