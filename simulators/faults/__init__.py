"""The faults a scene may call for, by name. A module is imported only when a scene names one of its faults."""

from __future__ import annotations

import importlib
from typing import Any

from palpate.instrument.errors import UnknownName

_TCP, _RTU, _CAN, _NODE, _DEVICE, _INDICATOR = (
    f"palpate.simulators.faults.{name}" for name in ("tcp", "rtu", "can", "node", "device", "indicator")
)

FAULTS: dict[str, str] = {
    # Modbus TCP: generator, amplifier and sample changer
    "no_reply": f"{_TCP}:NoReply",
    "late_reply": f"{_TCP}:LateReply",
    "split_reply": f"{_TCP}:SplitReply",
    "merged_replies": f"{_TCP}:MergedReplies",
    "truncated_reply": f"{_TCP}:TruncatedReply",
    "wrong_transaction": f"{_TCP}:WrongTransaction",
    "wrong_unit": f"{_TCP}:WrongUnit",
    "wrong_function": f"{_TCP}:WrongFunction",
    "wrong_count": f"{_TCP}:WrongCount",
    "device_busy": f"{_TCP}:DeviceBusy",
    "device_failure": f"{_TCP}:DeviceFailure",
    "illegal_value": f"{_TCP}:IllegalValue",
    "connection_reset": f"{_TCP}:ConnectionReset",
    "connection_refused": f"{_TCP}:ConnectionRefused",
    # Modbus RTU: the line of strain indicator and positioner
    "bit_error": f"{_RTU}:BitError",
    "lost_bytes": f"{_RTU}:LostBytes",
    "leading_glitch": f"{_RTU}:LeadingGlitch",
    "late_answer": f"{_RTU}:LateAnswer",
    "two_replies": f"{_RTU}:TwoReplies",
    "silence": f"{_RTU}:Silence",
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
    "node_reboot": f"{_NODE}:NodeReboot",
    "emergency": f"{_NODE}:Emergency",
    "saturated_film": f"{_NODE}:SaturatedFilm",
    "film_drift": f"{_NODE}:FilmDrift",
    # devices
    "power_cycle": f"{_DEVICE}:PowerCycle",
    "over_current": f"{_DEVICE}:OverCurrent",
    "over_temperature": f"{_DEVICE}:OverTemperature",
    "latched_fault": f"{_DEVICE}:LatchedFault",
    "front_panel": f"{_DEVICE}:FrontPanel",
    "stuck_reading": f"{_INDICATOR}:StuckReading",
    "bridge_open": f"{_INDICATOR}:BridgeOpen",
    "overload": f"{_INDICATOR}:Overload",
    "not_a_number": f"{_INDICATOR}:NotANumber",
    "zero_drift": f"{_INDICATOR}:ZeroDrift",
}


def fault_class(kind: str) -> type[Any]:
    """The class of a fault. Raises UnknownName."""
    if kind not in FAULTS:
        raise UnknownName("fault", kind, FAULTS)
    module, class_name = FAULTS[kind].split(":")
    found: type[Any] = getattr(importlib.import_module(module), class_name)
    return found
