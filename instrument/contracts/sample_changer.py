"""Sample changer, Modbus TCP. Our own map, after laboratory autosamplers.

A sample is ordered by its name. A tag reader tells the name of what lies under the probe, whoever laid it there.
"""

from __future__ import annotations

from palpate.instrument.contracts.contract import Access, Contract, Field, Identity, probe

PLACES = 8  # [A]
TRAVEL = 0.1  # m, travel of the carriage for any exchange [A]
NAME = 64  # bytes of a sample's name
FIRST_PLACE, REGISTERS_OF_PLACE = 0x60, NAME // 2


def _name(name: str, address: int, meaning: str, access: Access = "ro") -> Field:
    return Field(name, address, "text", meaning, access=access, default="", length=NAME)


CONTRACT = Contract(
    name="sample_changer",
    title="sample changer",
    bus="modbus",
    identity=Identity("Palpate", "SC-1", "1.0"),
    about=__doc__,
    fields=(
        probe(0x00),
        Field("speed", 0x02, "uint16", "speed of the carriage", "m/s", 1e-3, "rw", 1e-3, 0.2, 0.02),
        _name("order", 0x10, "write a sample's name to have it laid under the probe; refused where no place holds it "
              "(3), while the probe is down (4), while the changer moves (6)", "wo"),
        _name("mounted", 0x30, "name on the tag of what lies under the probe; empty: no tag is there"),
        Field("exchanges", 0x50, "uint32", "how often that has changed, by an order or by hand; kept without power"),
        Field("status", 0x52, "uint16", "status word", bits={"moving": 0, "probe_down": 1}),
        *(
            _name(f"place_{number}", FIRST_PLACE + REGISTERS_OF_PLACE * (number - 1),
                  f"name of the sample that belongs into place {number}; empty: none")
            for number in range(1, PLACES + 1)
        ),
    ),
)  # fmt: skip
