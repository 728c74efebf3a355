"""Configuration keys of the scene classifier."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt

DEFAULT_MODEL = "open_confined"
"""Built-in model: open water, or water confined by quay walls, moored rows or the banks of a channel."""


@dataclass(frozen=True, kw_only=True)
class SceneParams:
    """Parameters of the scene classification.

    Parameters
    ----------
    scene_model : str
        ONNX file of the scene classifier, or the name of a built-in one.
    scene_extent_m : float or None
        Half the side of the square in the top view, which must match the model; null: the extent of the model.
    scene_every : int
        Interval in frames at which the classifier runs.
    scene_hold : int
        Consecutive classifications that must agree on another scene before it changes.
    """

    scene_model: str = DEFAULT_MODEL
    scene_extent_m: Annotated[float, Gt(0)] | None = None
    scene_every: Annotated[int, Ge(1)] = 10
    scene_hold: Annotated[int, Ge(1)] = 3
