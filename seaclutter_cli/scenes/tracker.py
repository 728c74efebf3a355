"""The scene of each frame: looked at every so often, and held steady."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from seaclutter_cli.errors import ModelError
from seaclutter_cli.frame import Frame
from seaclutter_cli.scenes.image import top_view
from seaclutter_cli.scenes.model import SceneModel
from seaclutter_cli.scenes.params import SceneParams


@dataclass(frozen=True)
class SceneDecision:
    """Which scene a frame is taken for.

    Parameters
    ----------
    name : str
        The scene.
    probability : float
        What the classifier gave this scene when it last looked.
    decided : bool
        Whether it looked at this very frame; else the decision is carried on from an earlier one.
    probabilities : mapping of str to float
        What it gave each scene when it last looked.
    """

    name: str
    probability: float
    decided: bool
    probabilities: Mapping[str, float] = field(default_factory=dict)


class SceneTracker:
    """Tells the scene of the frames of one topic.

    The classifier looks at the first frame and then at one in ``scene_every``. Its first look decides; from then on the
    scene changes only when ``scene_hold`` looks in a row take the same other scene for the most probable. A frame with
    nothing in view says nothing: the next one is looked at in its place. Before any look the scene is the first of
    the model's, all being equally probable.

    **State**: the decision, frames to the next look, and how many looks in a row spoke for which other scene.

    Parameters
    ----------
    model : SceneModel
        The classifier.
    every, hold : int
        ``scene_every`` and ``scene_hold``.
    """

    def __init__(self, model: SceneModel, *, every: int, hold: int) -> None:
        self._model, self._every, self._hold = model, every, hold
        self.reset()

    @property
    def classes(self) -> tuple[str, ...]:
        """Scenes that the model knows."""
        return self._model.classes

    def reset(self) -> None:
        """Forget all state: a recording starts."""
        even = dict.fromkeys(self.classes, 1 / len(self.classes))
        self._decision = SceneDecision(self.classes[0], 1 / len(self.classes), False, even)
        self._wait = 0
        self._looked = False
        self._rival, self._for_rival = self.classes[0], 0

    def scene(self, frame: Frame) -> SceneDecision:
        """Return the scene of a frame; called once a frame, in order."""
        self._wait -= 1
        if self._wait < 0:
            image = top_view(frame.coordinates, self._model.extent_m)
            if image.any():
                self._wait = self._every - 1
                return self._decide(dict(zip(self.classes, self._model.probabilities(image).tolist(), strict=True)))
            self._wait = 0
        return replace(self._decision, decided=False)

    def _decide(self, probabilities: dict[str, float]) -> SceneDecision:
        likeliest = max(probabilities, key=lambda name: probabilities[name])
        name = self._decision.name
        self._for_rival = self._for_rival + 1 if likeliest == self._rival else 1
        self._rival = likeliest
        if not self._looked or self._for_rival >= self._hold:
            name = likeliest
        self._looked = True
        self._decision = SceneDecision(name, probabilities[name], True, probabilities)
        return self._decision


def make_scene_tracker(params: SceneParams) -> SceneTracker:
    """Return a judge without state.

    Raises
    ------
    MissingExtraError
        If onnxruntime is not installed.
    ModelError
        If the model cannot be used, or sees another square than the configuration asks for.
    """
    model = SceneModel(params.scene_model)
    if params.scene_extent_m is not None and not math.isclose(params.scene_extent_m, model.extent_m, rel_tol=1e-6):
        raise ModelError(
            f"{params.scene_model}: sees {model.extent_m:g} m to each side, scene_extent_m is {params.scene_extent_m:g}"
        )
    return SceneTracker(model, every=params.scene_every, hold=params.scene_hold)
