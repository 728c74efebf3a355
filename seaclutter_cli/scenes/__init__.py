"""Scenes: what surroundings a frame shows. Stands in for the classifier until that is there."""

from seaclutter_cli.errors import MissingExtraError
from seaclutter_cli.interfaces import SceneSource
from seaclutter_cli.scenes.params import SceneParams


def make_judge(params: SceneParams) -> SceneSource:  # noqa: ARG001
    """Return what tells the scene of frames; there is none yet."""
    raise MissingExtraError("telling the scene", "scene")
