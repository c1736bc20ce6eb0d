"""Writes the verdicts of limits as JUnit XML, which servers for continuous integration read and plot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from palpate.instrument.durable import put_whole
from palpate.instrument.uncertainty.decision import FAIL, PASS, UNDECIDED
from palpate.procedures.records.run import storing

if TYPE_CHECKING:
    from palpate.procedures.engine.verdict import Judgement
    from palpate.procedures.records.run import Run

NUMBERS = ("value", "u", "low", "high", "risk", "outside", "deciding_u")
AS = {FAIL: "failure", UNDECIDED: "error"}  # an undecided limit is none that was skipped: the server must not be green


def write_junit(judged: Judgement, run: Run, path: Path) -> None:
    """Write a test case for each limit, with its numbers as properties. Raises RecordError: it cannot be written."""
    outcomes = [each.outcome for each in judged.verdicts]
    counts = {"tests": len(outcomes), "failures": outcomes.count(FAIL), "errors": outcomes.count(UNDECIDED)}
    suites = ElementTree.Element("testsuites")
    named = {"name": run.procedure, "timestamp": run.started.isoformat(timespec="seconds")}
    suite = ElementTree.SubElement(suites, "testsuite", named | {name: str(count) for name, count in counts.items()})
    about = ElementTree.SubElement(suite, "properties")
    for name, text in (("run", str(run.folder)), ("simulated", str(run.simulated).lower())):
        ElementTree.SubElement(about, "property", name=name, value=text)
    for each in judged.verdicts:
        case = ElementTree.SubElement(suite, "testcase", classname=run.procedure, name=each.quantity)
        properties = ElementTree.SubElement(case, "properties")
        numbers = {name: getattr(each, name) for name in NUMBERS}
        if each.prior is not None:
            numbers |= {"prior_mean": each.prior.mean, "prior_sd": each.prior.sd}
        for name, number in numbers.items():
            if number is not None:
                ElementTree.SubElement(properties, "property", name=name, value=repr(float(number)))
        ElementTree.SubElement(properties, "property", name="unit", value=each.unit)
        if each.outcome != PASS:
            ElementTree.SubElement(case, AS[each.outcome], type=each.outcome, message=each.reason)
    ElementTree.indent(suites)
    with storing(path, "another file with --junit"):
        put_whole(path, ElementTree.tostring(suites, encoding="unicode", xml_declaration=False) + "\n")
