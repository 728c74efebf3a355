"""Scene classification: a small network recognises the surroundings of a frame in its top view [Bi].

Importing this package is cheap; heavy dependencies are imported when a tracker is made.
"""

from typing import TYPE_CHECKING

from seaclutter_cli.scenes.params import SceneParams

if TYPE_CHECKING:
    from seaclutter_cli.scenes.tracker import SceneTracker

__all__ = ["SceneParams", "make_scene_tracker"]


def make_scene_tracker(params: SceneParams) -> "SceneTracker":
    """Return a scene tracker; see `seaclutter_cli.scenes.tracker.make_scene_tracker`."""
    from seaclutter_cli.scenes import tracker

    return tracker.make_scene_tracker(params)
