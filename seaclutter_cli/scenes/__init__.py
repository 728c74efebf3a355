"""Scene classification: a small network recognises the surroundings of a frame in its top view [Bi].

Importing this package is cheap; heavy dependencies are imported when a tracker is made.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from seaclutter_cli.errors import ModelError
from seaclutter_cli.options import Number, Options, Whole, option
from seaclutter_cli.params import Count, Positive, key

if TYPE_CHECKING:
    from seaclutter_cli.scenes.model import SceneTracker

_DEFAULT_MODEL = "open_confined"
"""Built-in model: open water, or water confined by quay walls, moored rows or the banks of a channel."""


@dataclass(frozen=True, kw_only=True)
class SceneParams:
    """Parameters of the scene classification."""

    scene_model: str = key(_DEFAULT_MODEL, "ONNX file of the scene classifier, or the name of a built-in one.")
    scene_extent_m: Positive | None = key(
        None, "Half the side of the square in the top view, which must match the model; null: the extent of the model."
    )
    scene_every: Count = key(10, "Interval in frames at which the classifier runs.")
    scene_hold: Count = key(3, "Consecutive classifications that must agree on another scene before it changes.")


class TrainingParams(Options):
    """Parameters of the training."""

    place = 2

    epochs: int = option("--epochs", "Passes over all training frames.", default=30, kind=Whole(1))
    batch: int = option("--batch", "Frames per step.", default=32, kind=Whole(2))
    learning_rate: float = option(
        "--learning-rate RATE",
        "Initial learning rate of Adam; it falls to 0 along half a cosine.",
        default=0.005,
        kind=Number(0, above=True),
    )
    seed: int = option("--seed", "Seed of split, initial weights, order and rotations.", default=1, kind=Whole(0))


def make_scene_tracker(params: SceneParams) -> SceneTracker:
    """Return a scene tracker in its initial state.

    `MissingExtraError` if onnxruntime is not installed; `ModelError` if the model cannot be used, or its extent differs
    from the configured one.
    """
    from seaclutter_cli.scenes.model import SceneModel, SceneTracker

    model = SceneModel(params.scene_model)
    if params.scene_extent_m is not None and not math.isclose(params.scene_extent_m, model.extent_m, rel_tol=1e-6):
        raise ModelError(
            f"{params.scene_model}: the model covers {model.extent_m:g} m to each side, but scene_extent_m is "
            f"{params.scene_extent_m:g}; leave it out to use the extent of the model"
        )
    return SceneTracker(model, every=params.scene_every, hold=params.scene_hold)
