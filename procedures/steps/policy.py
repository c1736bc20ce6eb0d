"""What is done about each thing that can go wrong on a bench, in one table, and the doing of it.

A step of a procedure is carried out as a whole, or again as a whole: setting a load, recording a point, reading the
indicator. Between two attempts outputs go to zero, every device is identified again and gets its settings back. Each
incident is an event of the record, and each point says how many there were in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from palpate.drivers.bench import Bench
from palpate.drivers.devices.device import READ_ATTEMPTS
from palpate.instrument.errors import (
    BenchError,
    BenchInUse,
    DeviceError,
    IdentityError,
    LinkError,
    SafetyError,
    SampleError,
    SettingsLost,
    UnreachableError,
)

T = TypeVar("T")

ASK_AGAIN, READ_BACK, REPEAT, RESTORE, NOTE, MARK, USE, STOP = (
    "ask again", "read back", "repeat the step", "restore the settings, repeat the step", "note",
    "repeat the point, then mark it", "mark the point and use it", "stop",
)  # fmt: skip
ATTEMPTS = 3


@dataclass(frozen=True, slots=True)
class Policy:
    """What is done about an incident.

    Attributes:
        seen: by what it is known; errors of these classes, or what is written here.
        attempts: after so many in all the run stops, or the point is marked.
    """

    incident: str
    seen: tuple[type[BenchError], ...] | str
    does: str
    attempts: int = 1


# The first that fits an error counts.
POLICIES = (
    Policy("a limit of the bench is passed, or the amplifier has tripped", (SafetyError,), STOP),
    Policy("another device stands in the place of one", (IdentityError,), STOP),
    Policy("another program has the amplifier", (BenchInUse,), STOP),
    Policy("another sample is mounted than was ordered, or it was away meanwhile", (SampleError,), STOP),
    Policy("the rig cannot reach what is asked for", (UnreachableError,), STOP),
    Policy("settings are lost or changed: power cycle, reboot, front panel", (SettingsLost,), RESTORE, ATTEMPTS),
    Policy("a device does not answer, or the link is lost", (LinkError,), RESTORE, ATTEMPTS),
    Policy("a device refuses, or gives no valid reading", (DeviceError,), RESTORE, ATTEMPTS),
    Policy("no valid answer to a read", "in the driver", ASK_AGAIN, READ_ATTEMPTS),
    Policy("a write is not confirmed", "in the driver", READ_BACK),
    Policy("emergency, heartbeat gone, error frames: a node or its bus tells of itself", "after a step", NOTE),
    Policy("films clipped, not finite, unsettled; emergency in a dwell; load drifted", "of a point", MARK, ATTEMPTS),
    Policy(
        "films and load cell tell of two forces (`force`), films and generator of two frequencies (`frequency`): "
        "further apart than 6 points of 100,000 are by chance",
        "of a point", MARK, ATTEMPTS,
    ),
    Policy("hum, or the noise that prevails, cannot be told in so short a record (`hum`, `short`)", "of a point", USE),
)  # fmt: skip


def policy_for(error: BenchError) -> Policy:
    """The policy that counts for an error; what no policy speaks of stops the run."""
    for policy in POLICIES:
        if not isinstance(policy.seen, str) and isinstance(error, policy.seen):
            return policy
    return Policy("the bench cannot", (type(error),), STOP)


def carry_out(bench: Bench, what: str, step: Callable[[], T], again: Callable[[], object] = lambda: None) -> T:
    """Do a step; where the bench fails in it, do as the policy says. On a bench that is not attended, just do it.

    Args:
        what: names the step in incidents.
        again: what brings the bench from zero to where the step begins; called before it is repeated.

    Raises:
        BenchError: of the step, or of putting the bench right; outputs are off, and a device that failed is broken.
    """
    if not bench.attended:
        return step()
    driving = bench.driving
    attempt = 0
    while True:
        attempt += 1
        try:
            if attempt > 1:
                bench.recover()
                if driving:
                    bench.drive()
                again()
            result = step()
            bench.check_settings()
            return result
        except BenchError as error:
            policy = policy_for(error)
            if attempt >= policy.attempts:
                bench.declare_broken(error)
                raise
            bench.incidents.note(f"{what}: {error}; {policy.does}")
