"""The columns of a class of points or of result rows: what is said of a field, once, in `Annotated` at the field.

@dataclass(frozen=True, slots=True)
class TouchPoint:
    sample: Annotated[str, Column("name of the sample", head="sample")]
    force_ratio: Annotated[float, Column("force ratio", head="force\\nratio", cell="z.4f", u="force_ratio_u")]
    force_ratio_u: Annotated[float, Column(head="u", cell="z.4f")]

point = gathered(TouchPoint, step, forces)  # the sample of the step, the ratio and its uncertainty of the forces

A field has its place in the record, in JSON and in a printed table by its place in the class.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

from palpate.instrument.errors import ConfigError, quoted

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

P = TypeVar("P", bound="DataclassInstance")
LAST = "last"  # a column's place after all others


@dataclass(frozen=True, slots=True)
class Column:
    """What a field of a point or of a result row means, and how it is printed.

    Attributes:
        doc: what it is, for people; empty where another field names it as its `u`.
        unit: unit of its value; empty: it has none. That of a `u` is the unit of its value, if it says no other.
        head: heading in the printed table; empty: the field is not printed.
        cell: how it is printed: a format of its value times `scale`, where None is "-", such as "z.3f"; a text in which
            attributes of the row stand in braces, such as "{0.low:z.1f} to {0.high:z.1f}"; or a function of the row.
        scale: factor of the printed value.
        u: field that holds its standard uncertainty.
        after: field that it follows in the printed table, or LAST; empty: it follows the field before it.
        each: of a field that holds rows with columns of their own: the field of theirs that heads the columns of each.
    """

    doc: str = ""
    unit: str = ""
    head: str = ""
    cell: str | Callable[[Any], str] = ""
    scale: float = 1.0
    u: str = ""
    after: str = ""
    each: str = ""


def columns_of(kind: type[DataclassInstance]) -> dict[str, Column]:
    """The columns of a class, by their fields, in order. A field without a `Column` has none, unless it is a `u`.

    Raises:
        ConfigError: the class is no dataclass, a type in it is not known where it is defined, a field has two columns,
            or a column names a field that is none.
    """
    if not (isinstance(kind, type) and is_dataclass(kind)):
        raise ConfigError(f"{quoted(kind)} is no dataclass, and so it has no columns; decorate it with @dataclass")
    try:
        types = get_type_hints(kind, include_extras=True)
    except NameError as error:
        raise ConfigError(
            f"{kind.__name__}: {error}; import it where the class is defined, not in a function"
        ) from None
    found: dict[str, Column] = {}
    for name in (field.name for field in fields(kind)):
        own = [each for each in getattr(types[name], "__metadata__", ()) if isinstance(each, Column)]
        if len(own) > 1:
            raise ConfigError(f"{kind.__name__}.{name} has {len(own)} columns; give it one")
        if own:
            found[name] = own[0]
    for name, column in list(found.items()):
        for what, other in (("u", column.u), ("after", column.after)):
            if other and other != LAST and other not in types:
                raise ConfigError(f"{kind.__name__}.{name}: {what} {other!r} is no field of it; name one")
        if column.u:
            mine = found.get(column.u, Column())
            doc = mine.doc or f"standard uncertainty of `{name}`"
            found[column.u] = replace(mine, doc=doc, unit=mine.unit or column.unit)
    return {field.name: found[field.name] for field in fields(kind) if field.name in found}


def gathered(kind: type[P], *sources: object, **own: object) -> P:
    """A point or row of a class, each field from `own`, or else from the one source that has an attribute of its name.

    A field with a default that no source has keeps it.

    Raises:
        ConfigError: two sources have a field, or none has it, and `own` does not give it; or `own` gives no field.
    """
    values = dict(own)
    for field in fields(kind):
        name = field.name
        if name in own:
            continue
        having = [each for each in sources if hasattr(each, name)]
        if len(having) > 1:
            names = " and ".join(type(each).__name__ for each in having)
            raise ConfigError(f"{kind.__name__}.{name}: {names} both have it; say which is meant: {name}=...")
        if having:
            values[name] = getattr(having[0], name)
        elif field.default is MISSING and field.default_factory is MISSING:
            names = ", ".join(type(each).__name__ for each in sources) or "nothing"
            raise ConfigError(f"{kind.__name__}.{name}: it is in none of its sources ({names}); give it: {name}=...")
    if unknown := sorted(own.keys() - {field.name for field in fields(kind)}):
        raise ConfigError(f"{kind.__name__}.{unknown[0]}: there is no such field; leave {unknown[0]}=... out")
    return kind(**values)
