"""The effects of a scene by their places in the chain."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property

from palpate.simulators.physics.effect import Effect
from palpate.simulators.physics.stages import (
    AmplifierEffect,
    CanEffect,
    CellEffect,
    ConverterEffect,
    DriveEffect,
    FilmsEffect,
    HysteresisEffect,
    InputEffect,
    LeakEffect,
    LineEffect,
    ShakerEffect,
    ShareEffect,
    SourceEffect,
    StackEffect,
)

ONE_ALONE = (
    StackEffect, HysteresisEffect, AmplifierEffect, LeakEffect, ConverterEffect, CanEffect, LineEffect, CellEffect,
)  # fmt: skip


def rival(effect: Effect, among: Mapping[str, Effect]) -> str | None:
    """An effect that cannot stand beside this one: one excludes the other, or only one can act at their place."""
    for name, other in among.items():
        if name == effect.name:
            continue
        if name in effect.excludes or effect.name in other.excludes:
            return name
        if any(isinstance(effect, place) and isinstance(other, place) for place in ONE_ALONE):
            return name
        films = [each for each in (effect, other) if isinstance(each, FilmsEffect) and each.scatter is not None]
        if len(films) > 1:
            return name
    return None


class Effects(Mapping[str, Effect]):
    """Effects by name, in the order in which they were given; and by place, for which nobody else asks for types.

    A place where several may act gives all of them, any other the first one, or None.
    """

    def __init__(self, effects: Mapping[str, Effect]) -> None:
        self._effects = dict(effects)

    def __getitem__(self, name: str) -> Effect:
        return self._effects[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._effects)

    def __len__(self) -> int:
        return len(self._effects)

    def but(self, *others: Effect | None) -> Effects:
        """These effects without some of them."""
        return Effects({name: e for name, e in self.items() if not any(e is other for other in others)})

    def including(self, effect: Effect) -> Effects:
        """These effects and one more, which replaces another of its name."""
        return Effects({**self, effect.name: effect})

    @cached_property
    def drive(self) -> tuple[DriveEffect, ...]:
        return tuple(e for e in self.values() if isinstance(e, DriveEffect))

    @cached_property
    def shaker(self) -> tuple[ShakerEffect, ...]:
        return tuple(e for e in self.values() if isinstance(e, ShakerEffect))

    @cached_property
    def share(self) -> tuple[ShareEffect, ...]:
        return tuple(e for e in self.values() if isinstance(e, ShareEffect))

    @cached_property
    def stack(self) -> StackEffect | None:
        return next((e for e in self.values() if isinstance(e, StackEffect)), None)

    @cached_property
    def plays(self) -> HysteresisEffect | None:
        return next((e for e in self.values() if isinstance(e, HysteresisEffect)), None)

    @cached_property
    def films(self) -> tuple[FilmsEffect, ...]:
        return tuple(e for e in self.values() if isinstance(e, FilmsEffect))

    @cached_property
    def scattering(self) -> FilmsEffect | None:
        """The effect that draws the films' gains anew for each load set or mounting."""
        return next((e for e in self.films if e.scatter is not None), None)

    @cached_property
    def source(self) -> tuple[SourceEffect, ...]:
        return tuple(e for e in self.values() if isinstance(e, SourceEffect))

    @cached_property
    def leak(self) -> LeakEffect | None:
        return next((e for e in self.values() if isinstance(e, LeakEffect)), None)

    @cached_property
    def amplifier(self) -> AmplifierEffect | None:
        return next((e for e in self.values() if isinstance(e, AmplifierEffect)), None)

    @cached_property
    def input(self) -> tuple[InputEffect, ...]:
        return tuple(e for e in self.values() if isinstance(e, InputEffect))

    @cached_property
    def converter(self) -> ConverterEffect | None:
        return next((e for e in self.values() if isinstance(e, ConverterEffect)), None)

    @cached_property
    def can(self) -> CanEffect | None:
        return next((e for e in self.values() if isinstance(e, CanEffect)), None)

    @cached_property
    def cell(self) -> CellEffect | None:
        return next((e for e in self.values() if isinstance(e, CellEffect)), None)

    @cached_property
    def line(self) -> LineEffect | None:
        return next((e for e in self.values() if isinstance(e, LineEffect)), None)
