"""The faults a scene may call for, by name. A module is imported only when a scene names one of its faults."""

from __future__ import annotations

import importlib
from typing import Any

from palpate.instrument.errors import UnknownName

_MODBUS, _CAN, _DEVICE = (f"palpate.simulators.faults.{name}" for name in ("modbus", "can", "device"))

FAULTS: dict[str, str] = {
    # Modbus TCP: generator, amplifier and sample changer
    "no_reply": f"{_MODBUS}:NoReply",
    "late_reply": f"{_MODBUS}:LateReply",
    "split_reply": f"{_MODBUS}:SplitReply",
    "merged_replies": f"{_MODBUS}:MergedReplies",
    "truncated_reply": f"{_MODBUS}:TruncatedReply",
    "wrong_transaction": f"{_MODBUS}:WrongTransaction",
    "wrong_unit": f"{_MODBUS}:WrongUnit",
    "wrong_function": f"{_MODBUS}:WrongFunction",
    "wrong_count": f"{_MODBUS}:WrongCount",
    "device_busy": f"{_MODBUS}:DeviceBusy",
    "device_failure": f"{_MODBUS}:DeviceFailure",
    "illegal_value": f"{_MODBUS}:IllegalValue",
    "connection_reset": f"{_MODBUS}:ConnectionReset",
    "connection_refused": f"{_MODBUS}:ConnectionRefused",
    # Modbus RTU: the line of strain indicator and positioner
    "bit_error": f"{_MODBUS}:BitError",
    "lost_bytes": f"{_MODBUS}:LostBytes",
    "leading_glitch": f"{_MODBUS}:LeadingGlitch",
    "late_answer": f"{_MODBUS}:LateAnswer",
    "two_replies": f"{_MODBUS}:TwoReplies",
    "silence": f"{_MODBUS}:Silence",
    # CAN
    "lost_frame": f"{_CAN}:LostFrame",
    "duplicated_frame": f"{_CAN}:DuplicatedFrame",
    "delayed_frame": f"{_CAN}:DelayedFrame",
    "reordered_frames": f"{_CAN}:ReorderedFrames",
    "error_frame": f"{_CAN}:ErrorFrame",
    "bus_off": f"{_CAN}:BusOff",
    "bus_overload": f"{_CAN}:BusOverload",
    "no_heartbeat": f"{_CAN}:NoHeartbeat",
    "counter_repeats": f"{_CAN}:CounterRepeats",
    "counter_skips": f"{_CAN}:CounterSkips",
    "babbling_node": f"{_CAN}:BabblingNode",
    "node_reboot": f"{_CAN}:NodeReboot",
    "emergency": f"{_CAN}:Emergency",
    "saturated_film": f"{_CAN}:SaturatedFilm",
    "film_drift": f"{_CAN}:FilmDrift",
    # devices
    "power_cycle": f"{_DEVICE}:PowerCycle",
    "over_current": f"{_DEVICE}:OverCurrent",
    "over_temperature": f"{_DEVICE}:OverTemperature",
    "latched_fault": f"{_DEVICE}:LatchedFault",
    "front_panel": f"{_DEVICE}:FrontPanel",
    "stuck_reading": f"{_DEVICE}:StuckReading",
    "bridge_open": f"{_DEVICE}:BridgeOpen",
    "overload": f"{_DEVICE}:Overload",
    "not_a_number": f"{_DEVICE}:NotANumber",
    "zero_drift": f"{_DEVICE}:ZeroDrift",
}


def fault_class(kind: str) -> type[Any]:
    """The class of a fault. Raises UnknownName."""
    if kind not in FAULTS:
        raise UnknownName("fault", kind, FAULTS)
    module, class_name = FAULTS[kind].split(":")
    found: type[Any] = getattr(importlib.import_module(module), class_name)
    return found
