"""The inputs of a node that samples: which films are wired to it, and what is added to their voltages there."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable

import numpy as np
import numpy.typing as npt

from palpate.instrument.contracts.sensor_node import CHANNELS, place
from palpate.instrument.sensor.design import Film
from palpate.simulators.linear.lti import Floats
from palpate.simulators.physics.stages import InputEffect
from palpate.simulators.randomness import Stream
from palpate.simulators.rig.rig import Rig

Source = tuple[InputEffect, Stream, int | slice]


class FilmInputs:
    """The inputs of one node.

    A design with more films than one node has channels is wired to nodes 1, 2, ... in turn. Films that fit on one node
    are wired to every node.
    """

    def __init__(self, rig: Rig, node_id: int, number: int, channels: int = CHANNELS) -> None:
        """Wire a node.

        Args:
            rig: what the films feel.
            node_id: its node id, with which the random numbers of its inputs begin.
            number: which of the nodes that sample films it is, from 1; 0: no film is wired to it.
            channels: number of its channels.
        """
        self._rig, self._id, self._number, self.channels = rig, node_id, number, channels
        self._added = sorted(rig.effects.input, key=lambda effect: effect.name)
        self._sources: dict[int, list[Source]] = {}

    def volts(self, time_ns: npt.NDArray[np.int64], films: Floats, period_ns: int) -> Floats:
        """What its converter gets, shape (channels, n) [V].

        Args:
            time_ns: times of the samples, one SYNC period apart, shape (n,) [ns].
            films: voltage at each channel, shape (channels, n) [V].
            period_ns: the SYNC period [ns].
        """
        volts = films.copy()
        rates = functools.cache(lambda: self.film_channels @ self._rig.film_rates(time_ns, period_ns))
        for effect, stream, channel in self._added_by(period_ns):
            volts[channel] += effect.volts(stream, time_ns, period_ns, functools.partial(_row, rates, channel))
        return volts

    def _added_by(self, period_ns: int) -> list[Source]:
        """The effects at the input, each with its stream and channels; kept, so that streams keep what they drew."""
        if period_ns not in self._sources:
            its: list[Source] = []
            for effect in self._added:
                channels: Iterable[int | slice] = [slice(None)] if effect.common else range(self.channels)
                for number, channel in enumerate(channels):
                    stream = Stream(self._rig.scene.seed, effect.name, self._id, number, period_ns)
                    its.append((effect, stream, channel))
            self._sources[period_ns] = its
        return self._sources[period_ns]

    @functools.cached_property
    def film_channels(self) -> Floats:
        """Matrix of zeros and ones, shape (channels, films), that puts each film of this node on its channel."""
        films = self._rig.scene.design.films
        matrix = np.zeros((self.channels, len(films)))
        for i, film in enumerate(films):
            channel = self.wired(film)
            if channel is not None:
                matrix[channel - 1, i] = 1.0
        return matrix

    def wired(self, film: Film) -> int | None:
        """This node's channel of a film, from 1; None: the film is wired to another node."""
        node, channel = place(film.channel, self.channels)
        films = self._rig.scene.design.films
        alike = self._number > 0 and all(place(other.channel, self.channels)[0] == 1 for other in films)
        return channel if alike or node == self._number else None


def _row(rows: Callable[[], Floats], number: int | slice) -> Floats:
    row: Floats = rows()[number]
    return row
