"""Incidents are counted and told to the record, those from before it was open as well."""

from __future__ import annotations

from palpate.drivers.incident import Incidents
from palpate.simulators.clock import VirtualClock


def test_incidents_are_stored_with_their_time_also_those_from_before_the_record() -> None:
    clock, stored = VirtualClock(), list[tuple[str, str, int]]()
    incidents, begun = Incidents(clock), clock.now_ns()
    incidents.note("first")
    clock.wait(1.0)
    incidents.note("second")
    incidents.tell(lambda *event: stored.append(event))
    clock.wait(1.0)
    incidents.note("third")
    assert stored == [
        ("incident", "first", begun),
        ("incident", "second", begun + 1_000_000_000),
        ("incident", "third", begun + 2_000_000_000),
    ]


def test_what_comes_while_the_record_is_closed_waits_for_the_next() -> None:
    incidents = Incidents(VirtualClock())
    first, second = list[str](), list[str]()
    incidents.tell(lambda _kind, what, _ns: first.append(what))
    incidents.hold()
    incidents.note("late")
    assert first == []
    incidents.tell(lambda _kind, what, _ns: second.append(what))
    assert second == ["late"]
    incidents.tell(lambda _kind, what, _ns: first.append(what))
    assert first == []
