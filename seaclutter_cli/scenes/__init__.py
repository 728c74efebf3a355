"""Scenes: a small network looks at a frame from above and tells what surroundings it shows (S3).

Importing this costs nothing; what is heavy comes in when a judge is made.
"""

from typing import TYPE_CHECKING

from seaclutter_cli.scenes.params import SceneParams

if TYPE_CHECKING:
    from seaclutter_cli.scenes.tracker import SceneTracker

__all__ = ["SceneParams", "make_scene_tracker"]


def make_scene_tracker(params: SceneParams) -> "SceneTracker":
    """Return a scene tracker, as `seaclutter_cli.scenes.tracker.make_scene_tracker` does."""
    from seaclutter_cli.scenes import tracker

    return tracker.make_scene_tracker(params)
