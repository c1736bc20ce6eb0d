"""One table of what can go wrong on a bench and what is then done, and the function that does it.

A step of a procedure, such as setting a load or recording a point, is carried out as a whole and repeated as a whole.
Between two attempts the outputs go to zero, and every device is identified again and gets its settings back. Each
incident is an event of the record, and each point says how many incidents it had.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from palpate.instrument.bench.description import READ_ATTEMPTS
from palpate.instrument.errors import (
    BenchError,
    BenchInUse,
    DeviceError,
    IdentityError,
    LinkError,
    SafetyError,
    SampleError,
    SettingsLost,
    Unfed,
    UnreachableError,
)

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench

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
        incident: what goes wrong.
        seen: the errors by which it is known, or where it is noticed.
        does: what is done about it.
        attempts: number of attempts in all, after which the run stops or the point is marked.
    """

    incident: str
    seen: tuple[type[BenchError], ...] | str
    does: str
    attempts: int = 1


# The first policy that fits an error counts.
POLICIES = (
    Policy("a limit of the bench is passed, or the exciter has tripped", (SafetyError,), STOP),
    Policy("another device answers at the address of one", (IdentityError,), STOP),
    Policy("another program has the exciter", (BenchInUse,), STOP),
    Policy("another sample is mounted than was ordered, or it was away meanwhile", (SampleError,), STOP),
    Policy("the rig cannot reach what is asked for", (UnreachableError,), STOP),
    Policy("settings are lost or changed: power cycle, reboot, front panel", (SettingsLost,), RESTORE, ATTEMPTS),
    Policy("a device does not answer, or the link is lost", (LinkError,), RESTORE, ATTEMPTS),
    Policy("a device refuses, or gives no valid reading", (DeviceError,), RESTORE, ATTEMPTS),
    Policy("no valid answer to a read", "in the driver", ASK_AGAIN, READ_ATTEMPTS),
    Policy("a write is not confirmed", "in the driver", READ_BACK),
    Policy("a node or its bus reports trouble: emergency, missing heartbeat, error frames", "after a step", NOTE),
    Policy("films clipped, not finite, unsettled; emergency in a dwell; load drifted", "of a point", MARK, ATTEMPTS),
    Policy(
        "films and load cell measure different forces (`force`), films and exciter have different frequencies "
        "(`frequency`), further apart than noise explains (by noise alone only 6 points of 100,000)",
        "of a point", MARK, ATTEMPTS,
    ),
    Policy("the record is too short to separate hum (`hum`), or to know its noise (`short`)", "of a point", USE),
)  # fmt: skip


def policy_for(error: BenchError) -> Policy:
    """The policy for an error. An error without one stops the run."""
    for policy in POLICIES:
        if not isinstance(policy.seen, str) and isinstance(error, policy.seen):
            return policy
    return Policy("the bench cannot", (type(error),), STOP)


def carry_out(bench: Bench, what: str, step: Callable[[], T], again: Callable[[], object] = lambda: None) -> T:
    """Carry out a step and return what it returns. If the bench fails, do what the policy says.

    On a bench whose incidents nobody records (`Bench.attend`), the step is carried out once.

    Args:
        bench: the open bench.
        what: names the step in incidents.
        step: the step.
        again: brings the bench from zero to where the step begins. It is called before the step is repeated.

    Raises:
        BenchError: the step failed, or the bench could not be put right. The outputs are off, and the device that
            failed counts as broken.
    """
    if not bench.attended:
        return step()
    driving = bench.driving
    bench.incidents.first = ""
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
                if isinstance(error, Unfed) and bench.incidents.first:
                    raise Unfed(bench.incidents.first, f"After that, {error.args[0]}", device=error.device) from error
                raise
            bench.incidents.note(f"{what}: {error}; {policy.does}")
