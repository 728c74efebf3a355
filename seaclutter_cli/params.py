"""Declaration of parameters: the field of a dataclass with its type, limits, default, and meaning."""

from dataclasses import MISSING, dataclass, field
from typing import Annotated, Any

from annotated_types import Ge, Gt, Interval

Share = Annotated[float, Interval(ge=0, le=1)]
Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Count = Annotated[int, Ge(1)]


@dataclass(frozen=True)
class OneOf:
    """Annotation of a parameter that is one of several names, which are those of a ``noun``."""

    noun: str
    names: tuple[str, ...]


def key(default: Any = MISSING, meaning: str = "", *, formerly: str = "", factory: Any = MISSING) -> Any:
    """Return the dataclass field of a key with its meaning; a former name still loads, with a warning."""
    return field(default=default, default_factory=factory, metadata={"meaning": meaning, "formerly": formerly})
