"""Orders with a handshake: what must come before, what says that they are done, and what must be cleared."""

from __future__ import annotations

import math
from typing import Protocol

from palpate.drivers.clock import Clock
from palpate.instrument.contracts.contract import Command, Condition, Contract, Value
from palpate.instrument.errors import DeviceError

POLL, POLLS = 0.01, 100  # least time between two looks at a device [s]; number of looks at a command that takes longer


class Ordered(Protocol):
    """A device that takes orders: its fields can be written and read."""

    name: str
    contract: Contract
    clock: Clock

    def give(self, **values: Value) -> None: ...

    def held(self, name: str) -> float: ...


def carry_out(device: Ordered, name: str) -> None:
    """Give a command once, with those that must come before it, and wait until each is done.

    Raises:
        UnknownName: the contract has no such command; nothing is sent.
        DeviceError: the device refuses one, or has not done it in time; the message names command, state and limit.
        LinkError, LinkTimeout: one is not confirmed; it may have been carried out.
    """
    for each in _in_order(device.contract, name):
        _give(device, each)


def _in_order(contract: Contract, name: str) -> list[Command]:
    """A command behind all that must come before it, each once."""
    found: dict[str, Command] = {}

    def add(wanted: str) -> None:
        command = contract.command(wanted)
        for before in command.after:
            if before not in found:
                add(before)
        found[wanted] = command

    add(name)
    return list(found.values())


def _give(device: Ordered, command: Command) -> None:
    device.give(**{command.field: command.value})
    failure = _await(device, command) if command.done or command.failed else ""
    if command.clear is not None:
        device.give(**{command.field: command.clear})
    if failure:
        raise DeviceError(f"{device.name}: {failure}", device=device.name)


def _await(device: Ordered, command: Command) -> str:
    """Wait until a command is done; returns the text of its refusal, or an empty one.

    Raises DeviceError: it is neither done nor refused in time.
    """
    fields = dict.fromkeys(each.field for each in (command.failed, command.done) if each)
    until = device.clock.now_ns() + round(1e9 * command.seconds)
    while True:
        states = {name: _raw(device, name) for name in fields}  # each once, because some devices clear it when read
        if command.failed and command.failed.holds(states[command.failed.field]):
            return f"refuses the command {command.name!r}: {_shown(command.failed, states)}"
        if command.done and command.done.holds(states[command.done.field]):
            return ""
        left = 1e-9 * (until - device.clock.now_ns())
        if left <= 0:
            break
        device.clock.wait(min(max(POLL, command.seconds / POLLS), left))
    if command.done is None:
        return ""
    wanted = " or ".join(map(str, command.done.values))
    raise DeviceError(
        f"{device.name}: the command {command.name!r} was not done within {command.seconds:g} s: "
        f"{_shown(command.done, states)}, should read {wanted}; look at the device",
        device=device.name,
    )


def _shown(condition: Condition, states: dict[str, float]) -> str:
    masked = "" if condition.mask is None else f" (of which 0x{condition.mask:X} counts)"
    return f"{condition.field} reads {states[condition.field]:.10g}{masked}"


def _raw(device: Ordered, name: str) -> float:
    """What a field reads, as a raw value; NaN if it has no reading."""
    value = device.held(name)
    return device.contract[name].to_raw(value) if math.isfinite(value) else value
