"""Scenes: a small network looks at a frame from above and tells what surroundings it shows (S3).

Importing this costs nothing; what is heavy comes in when a judge is made.
"""

from typing import TYPE_CHECKING

from seaclutter_cli.scenes.params import SceneParams

if TYPE_CHECKING:
    from seaclutter_cli.scenes.judge import SceneJudge

__all__ = ["SceneParams", "make_judge"]


def make_judge(params: SceneParams) -> "SceneJudge":
    """Return a judge of scenes, as `seaclutter_cli.scenes.judge.make_judge` does."""
    from seaclutter_cli.scenes import judge

    return judge.make_judge(params)
