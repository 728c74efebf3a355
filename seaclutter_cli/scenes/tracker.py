"""Scene of each frame, classified at intervals and kept stable."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from seaclutter_cli.frame import Frame
from seaclutter_cli.scenes.model import SceneModel, top_view


@dataclass(frozen=True)
class SceneDecision:
    """The scene of a frame: class, its probability and those of all classes in the latest classification.

    Unless this frame was classified itself, the decision is carried over from an earlier one.
    """

    name: str
    probability: float
    decided: bool
    probabilities: Mapping[str, float] = field(default_factory=dict)


class SceneTracker:
    """Scene of each frame of one topic.

    The first frame is classified, and then one frame in ``every``. The first classification decides; after that, the
    scene changes only when ``hold`` consecutive classifications find the same other scene most probable. A frame with
    nothing in view is not classified; the next frame is used instead. Before the first classification, the scene is the
    first class of the model, and all classes are equally probable.

    **State**: the decision, the number of frames until the next classification, and the rival scene with its number of
    consecutive classifications.
    """

    def __init__(self, model: SceneModel, *, every: int, hold: int) -> None:
        self._model, self._every, self._hold = model, every, hold
        self.reset()

    @property
    def classes(self) -> tuple[str, ...]:
        """Classes of the model."""
        return self._model.classes

    def reset(self) -> None:
        """Forget all state at the start of a recording."""
        even = dict.fromkeys(self.classes, 1 / len(self.classes))
        self._decision = SceneDecision(self.classes[0], 1 / len(self.classes), False, even)
        self._wait = 0
        self._has_decided = False
        self._rival, self._rival_count = self.classes[0], 0

    def scene(self, frame: Frame) -> SceneDecision:
        """Return the scene of a frame; called once for each frame, in order."""
        self._wait -= 1
        if self._wait < 0:
            image = top_view(frame.coordinates, self._model.extent_m)
            if image.any():
                self._wait = self._every - 1
                return self._decide(dict(zip(self.classes, self._model.probabilities(image).tolist(), strict=True)))
            self._wait = 0
        return replace(self._decision, decided=False)

    def _decide(self, probabilities: dict[str, float]) -> SceneDecision:
        most_probable = max(probabilities, key=lambda name: probabilities[name])
        name = self._decision.name
        self._rival_count = self._rival_count + 1 if most_probable == self._rival else 1
        self._rival = most_probable
        if not self._has_decided or self._rival_count >= self._hold:
            name = most_probable
        self._has_decided = True
        self._decision = SceneDecision(name, probabilities[name], True, probabilities)
        return self._decision
