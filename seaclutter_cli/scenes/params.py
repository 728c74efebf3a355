"""What a configuration says of the scene classifier."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt

DEFAULT_MODEL = "open_confined"
"""The model that comes with the program: open water, or confined by quay walls, moored rows, the banks of a channel."""


@dataclass(frozen=True, kw_only=True)
class SceneParams:
    """How the scene is told from frames.

    Parameters
    ----------
    scene_model : str
        ONNX file of the scene classifier, or the name of one that comes with the program.
    scene_extent_m : float or None
        Half side of the square seen from above; none: that of the model, which fits no other.
    scene_every : int
        Only every so many frames are looked at.
    scene_hold : int
        Looks in a row that must agree on another scene before it changes.
    """

    scene_model: str = DEFAULT_MODEL
    scene_extent_m: Annotated[float, Gt(0)] | None = None
    scene_every: Annotated[int, Ge(1)] = 10
    scene_hold: Annotated[int, Ge(1)] = 3
