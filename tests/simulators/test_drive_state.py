"""The state machine of a drive (CiA 402-2): figure and table of its states, with the option codes of a quick stop."""

from __future__ import annotations

import pytest

from palpate.simulators.devices.positioner import (
    DISABLED,
    ENABLED,
    FAULT,
    QUICK_STOPPING,
    READY,
    RESET,
    SWITCHED_ON,
    DriveState,
)


def after(*words: int, option: int = 2) -> int:
    """State of a drive after these controlwords."""
    state = DriveState()
    for word in words:
        state.control(word, option)
    return state.bits


@pytest.mark.parametrize(
    ("words", "ends"),
    [
        ((0x06,), READY),
        ((0x06, 0x07), SWITCHED_ON),
        ((0x06, 0x07, 0x0F), ENABLED),
        ((0x0F,), DISABLED),  # it must be ready first
        ((0x07,), DISABLED),
        ((0x06, 0x07, 0x0F, 0x07), SWITCHED_ON),
        ((0x06, 0x07, 0x0F, 0x06), READY),
        ((0x06, 0x07, 0x0F, 0x00), DISABLED),
    ],
)
def test_a_drive_goes_from_state_to_state_in_their_order(words: tuple[int, ...], ends: int) -> None:
    assert after(*words) == ends


@pytest.mark.parametrize(("option", "ends"), [(-3, DISABLED), (1, DISABLED), (2, DISABLED), (5, QUICK_STOPPING)])
def test_a_quick_stop_ends_in_the_state_of_its_option_code(option: int, ends: int) -> None:
    assert after(0x06, 0x07, 0x0F, 0x02, option=option) == ends
    assert after(0x06, 0x07, 0x0F, 0x02, 0x06, option=option) == (READY if ends == DISABLED else QUICK_STOPPING)
    assert after(0x06, 0x02, option=option) == DISABLED  # nothing moves that could be braked


def test_a_fault_stays_until_a_rising_reset() -> None:
    state = DriveState()
    state.control(RESET, 2)
    state.fail()
    for word, bits in ((RESET, FAULT), (0x06, FAULT), (RESET, DISABLED)):
        state.control(word, 2)
        assert state.bits == bits
