"""The names of the effects that a scene can call for."""

from palpate.simulators.effects import GROUP, effect_names

__all__ = ["GROUP", "effect_names"]
