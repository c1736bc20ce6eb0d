"""The whole bench: opens what the bench file lists, checks each identity, and ends with outputs off."""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import ExitStack, suppress
from types import FrameType, TracebackType
from typing import Any, Self

from palpate.drivers.bench_lock import BenchLock
from palpate.drivers.clock import BenchClock
from palpate.drivers.devices.device import READ_ATTEMPTS
from palpate.drivers.devices.positioner import Positioner
from palpate.drivers.devices.sample_changer import ChangerAndPerson, SampleChanger
from palpate.drivers.devices.sensor_node import SensorNode
from palpate.drivers.devices.shaker_amplifier import ShakerAmplifier
from palpate.drivers.devices.signal_generator import SignalGenerator
from palpate.drivers.devices.strain_indicator import StrainIndicator
from palpate.drivers.incident import Incidents, Store
from palpate.drivers.links.can import CanLink
from palpate.drivers.links.modbus import ModbusLink
from palpate.drivers.safe_end import held, taken
from palpate.drivers.watched_clock import WatchedClock
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.operator import Operator
from palpate.instrument.errors import BenchError, BenchInUse, DeviceError, SettingsLost

RECOVERY = 1.0  # s, that devices are given to come back
CLAIMS = 10  # that are tried within the time of the watchdog
TERMINATIONS = (signal.SIGTERM, signal.SIGHUP)  # a closed terminal hangs up
ENDINGS = (signal.SIGINT, *TERMINATIONS)


class Bench:
    """All devices of a bench, as a context manager.

    On entry every device is opened and identified, the generator is set to zero and the amplifier
    disabled. On every way out, SIGINT, SIGTERM and SIGHUP included, the generator is zeroed and the amplifier
    disabled again; where that fails, or the program is killed, the amplifier's watchdog drops the output.
    """

    def __init__(self, description: BenchDescription, clock: BenchClock, operator: Operator) -> None:
        self.description = description
        self.operator = operator
        self.changer: SampleChanger | None = None
        self.force_limit = description.force_limit
        generator, amplifier = description.signal_generator, description.shaker_amplifier
        self.generator = SignalGenerator(ModbusLink.tcp(generator), generator.unit)
        owned = amplifier.watchdog_fed_by == "owner"
        self.amplifier = ShakerAmplifier(ModbusLink.tcp(amplifier), amplifier.unit, owned=owned)
        self.clock = WatchedClock(clock, self.amplifier, description.watchdog)
        line = ModbusLink.rtu(description.line)
        self.indicator = StrainIndicator(line, description.strain_indicator.unit, self.clock)
        self.positioner = Positioner(line, description.positioner.unit, self.clock)
        self._can = can = CanLink(description.can)
        self.nodes = [SensorNode(can, node_id, self.clock) for node_id in description.can.nodes]
        self.incidents = Incidents(self.clock)
        self.attended = False
        self.waits: Callable[[str], object] = lambda _why: None  # told before it has to wait for somebody else
        self._safe = True
        self._other_links: list[ModbusLink | CanLink] = [line, can]
        if (place := description.sample_changer) is not None:
            self.changer = SampleChanger(ModbusLink.tcp(place), place.unit, self.clock)
            self.operator = ChangerAndPerson(self.changer, operator)
            self._other_links.append(self.changer.link)
        for device in self.devices:
            if device is not self.amplifier:
                device.afterwards = self.clock.feed_in_time
        self.is_open = False
        self._stack = ExitStack()

    @property
    def devices(
        self,
    ) -> list[SignalGenerator | ShakerAmplifier | StrainIndicator | Positioner | SensorNode | SampleChanger]:
        changers = [] if self.changer is None else [self.changer]
        return [self.generator, self.amplifier, self.indicator, self.positioner, *self.nodes, *changers]

    @property
    def simulated(self) -> bool:
        """Whether any device says that it is simulated."""
        return any(device.simulated for device in self.devices)

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(BenchLock(self.description))
            stack.enter_context(taken(TERMINATIONS, _terminate))
            self._open(self.amplifier.link, stack)
            self.amplifier.connect()
            self._claim()
            stack.callback(self._release)
            stack.enter_context(self.clock.beating())
            self.amplifier.disable()  # a bench that was left driving stops, whatever cannot be opened next
            self._open(self.generator.link, stack)
            self.generator.connect()
            stack.push(self._make_safe)
            for link in self._other_links:
                self._open(link, stack)
            self.indicator.connect()
            self.positioner.connect()
            for node in self.nodes:
                node.connect()
            if self.changer is not None:
                self.changer.connect()
            self.generator.output(False)
            self.generator.sine(10.0, 0.0)
            self._configure()
            self._stack = stack.pop_all()
        self.is_open = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.is_open = False
        self._stack.__exit__(kind, error, trace)  # the second time nothing is left of it

    def _open(self, link: ModbusLink | CanLink, stack: ExitStack) -> None:
        link.open()
        stack.callback(link.close)

    def _claim(self) -> None:
        """Become the amplifier's owner; the claim of a program that was killed ends after the watchdog's time.

        Raises BenchInUse: another program owns it and is alive; nothing has been changed.
        """
        if self.amplifier.claim():
            return
        watchdog = self.amplifier.get("watchdog")
        self.waits(
            f"{self.amplifier.name}: belongs to another program, or to one that was killed; waiting {watchdog:g} s, "
            "after which a killed one's claim ends"
        )
        piece = watchdog / CLAIMS
        for _ in range(CLAIMS):
            self.clock.wait(piece)
            if self.amplifier.claim():
                return
        raise BenchInUse(
            f"{self.amplifier.name}: belongs to another program, which feeds its watchdog; wait for it or end it"
        )

    def _release(self) -> None:
        if self._safe:
            with suppress(BenchError), held(ENDINGS):  # its output is off, and nobody feeds its watchdog any more
                self.amplifier.release()

    @property
    def cautions(self) -> list[str]:
        """What a person should know before the bench drives."""
        if self.amplifier.owned:
            return []
        return [
            f"{self.amplifier.name}: any request feeds its watchdog, so that whoever else reads it keeps its output on "
            "when this program dies; see that nobody does"
        ]

    def _configure(self) -> None:
        """Put the bench file's settings into amplifier and indicator.

        Raises:
            SafetyError: the amplifier has tripped on anything but its watchdog, which every killed run leaves.
        """
        if self.amplifier.read().faults_latched == {"watchdog"}:
            self.amplifier.clear_faults()
        self.amplifier.check()
        amplifier, indicator = self.description.shaker_amplifier, self.description.strain_indicator
        self.amplifier.configure(amplifier.gain, amplifier.current_limit, self.description.watchdog)
        self.indicator.configure(indicator.gage_factor, 1e3 * indicator.full_scale)

    def drive(self) -> None:
        """Enable the amplifier and close the generator's output, at zero amplitude; watching starts.

        Raises:
            DeviceError: a fault is latched; see `ShakerAmplifier.clear_faults`.
        """
        self.generator.sine(10.0, 0.0)
        self.amplifier.enable()
        self.generator.output(True)
        self.clock.watching = True

    def rest(self) -> None:
        """Outputs to zero: amplitude, output relay, amplifier."""
        self.clock.watching = False
        self.generator.sine(10.0, 0.0)
        self.generator.output(False)
        self.amplifier.disable()

    def attend(self, store: Store) -> None:
        """From now on what fails is made good where that is safe, and each incident stored by `store` as it happens.

        Without a record of it nothing is made good: the first failure is raised.
        """
        self.attended = True
        self.incidents.tell(store)
        for device in self.devices:
            device.read_attempts, device.noticed = READ_ATTEMPTS, self.incidents.note

    @property
    def driving(self) -> bool:
        """Whether the outputs are on."""
        return self.clock.watching

    @property
    def broken(self) -> list[str]:
        """Why devices are not used any more."""
        return [device.broken for device in self.devices if device.broken]

    def declare_broken(self, error: BenchError) -> None:
        """No later step uses the device that failed, but to switch it off."""
        for device in self.devices:
            if device.name == error.device and not device.broken:
                device.broken = str(error)
                self.incidents.note(f"{device.name}: is broken")

    def check_settings(self) -> None:
        """See that all devices hold what was written, and note what they have told of themselves.

        Raises:
            SettingsLost: one does not. LinkError, DeviceError: one does not answer.
        """
        for device in self.devices:
            for notice in device.notices():
                self.incidents.note(notice)
        if errors := self._can.error_frames():  # those before the nodes' answers have come
            self.incidents.note(f"{self._can.name}: {errors} error frames")
        for device in self.devices:
            if found := device.differences():
                raise SettingsLost(f"{'; '.join(found)}; look at the device", device=device.name)

    def recover(self) -> None:
        """Outputs to zero; then every device is identified again and gets the settings that it has lost.

        Raises:
            SafetyError: the amplifier has tripped. IdentityError: another device stands in the place of one.
            LinkError, DeviceError: one does not answer, or does not take its settings; the indicator reads no load.
        """
        self.clock.watching = False
        self._switch_off()
        self.clock.wait(RECOVERY)
        self.rest()
        self.amplifier.check()
        for device in self.devices:
            device.identify()
            if device is self.amplifier:
                self._claim()
            lost = device.differences()
            device.restore()
            for found in lost:
                self.incidents.note(f"{found}; written again")
        if sick := self.indicator.read().sick:
            name = self.indicator.name
            raise DeviceError(f"{name}: {sick}; check the bridge and its wires", device=name)

    def _make_safe(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        """Switch off by every means there is, whatever fails; signals meanwhile are ignored."""
        self.clock.watching = False
        self.incidents.hold()
        self.amplifier.broken = self.generator.broken = ""
        with held(ENDINGS):
            failures = self._switch_off()
        self._safe = not failures
        if failures:
            message = (
                "outputs could not all be switched off: "
                + "; ".join(failures)
                + f". The amplifier's watchdog drops its output within {self.description.watchdog:g} s; check by eye"
            )
            if error is None:
                raise BenchError(message)
            error.add_note(message)

    def _switch_off(self) -> list[str]:
        """By every means there is; returns what failed."""
        failures = []
        for step in (self.amplifier.disable, lambda: self.generator.output(False), self._zero):
            try:
                step()
            except Exception as failure:  # of a defect too: the next means must still be tried
                failures.append(str(failure))
        return failures

    def _zero(self) -> None:
        self.generator.sine(10.0, 0.0)


def _terminate(number: int, _frame: FrameType | None) -> None:
    """SIGTERM and SIGHUP take the same way out as everything else."""
    raise SystemExit(128 + number)
