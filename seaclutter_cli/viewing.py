"""The Rerun viewer: frames, reasons, boxes, clusters and curves are streamed to it, on one timeline."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Bytes, Mask
from seaclutter_cli.errors import UsageError, requiring
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.messages.scene import SceneBox
from seaclutter_cli.reporting import palette
from seaclutter_cli.reporting.collector import FrameListener, ScoredFrame
from seaclutter_cli.reporting.sample import boxes_of

_LOOPBACK = "127.0.0.1"
_FLUSH_S = 30.0


def require_rerun() -> Any:
    """Return the ``rerun`` module; raise `MissingExtraError` if it is not installed."""
    with requiring("the viewer", "view"):
        import rerun
    return rerun


class FrameStream(FrameListener):
    """Listener that sends all points of each frame and the result of a method to a viewer.

    ``sink`` connects the new recording stream to a file or viewer; it is called before any data are logged.
    """

    def __init__(self, params: EvaluationParams, sink: Callable[[Any], None]) -> None:
        self._rerun = require_rerun()
        self._params = params
        self._recording = self._rerun.RecordingStream("seaclutter")
        sink(self._recording)
        self._recording.send_blueprint(_blueprint(self._rerun))
        self._log = self._recording.log
        self._name, self._frames = "", 0

    def begin(self, recording: str) -> None:
        """Start a recording; its frames follow those of the previous one."""
        self._name = recording

    def add(self, scored: ScoredFrame) -> None:
        """Take a frame and its result."""
        frame, result = scored.frame, scored.results[0]
        self._recording.set_time("time", timestamp=np.datetime64(frame.stamp_ns, "ns"))
        self._recording.set_time("frame", sequence=self._frames)
        self._frames += 1
        scene = f", scene {result.scene}" if result and result.scene else ""
        self._log("recording", self._rerun.TextLog(f"{self._name}, frame {frame.index}{scene}"))
        self._points(frame, result)
        if result is not None:
            for name, boxes in boxes_of(result, scored.truth, self._params).items():
                self._boxes(name, boxes)
            self._curves(result)

    def finish(self) -> None:
        """Send the remaining data and disconnect."""
        self._recording.flush(timeout_sec=_FLUSH_S)
        self._recording.disconnect()

    def _points(self, frame: Frame, result: FilterResult | None) -> None:
        valid = frame.valid
        self._cloud("world/raw", frame, valid, _shades(frame, valid), 1.0)
        for reason, color in palette.REASONS.items():
            if reason is Reason.INVALID or result is None:
                continue
            path = "world/kept" if reason is Reason.KEPT else f"world/removed/{reason.name.lower()}"
            size = 2.0 if reason in (Reason.KEPT, Reason.OUTLIER) else 1.2
            self._cloud(path, frame, valid & (result.reason == reason), _colors([color]), size)

    def _cloud(self, path: str, frame: Frame, shown: Mask, colors: Any, size: float) -> None:
        positions = frame.coordinates[:, shown].T.astype(np.float32)
        radii = self._rerun.Radius.ui_points(size)
        self._log(path, self._rerun.Points3D(positions, colors=colors, radii=radii))

    def _boxes(self, name: str, boxes: Sequence[SceneBox]) -> None:
        rotations = [[0.0, 0.0, np.sin(box.yaw / 2), np.cos(box.yaw / 2)] for box in boxes]
        entity = self._rerun.Boxes3D(
            centers=np.array([box.center for box in boxes], np.float64).reshape(-1, 3),
            sizes=np.array([box.size for box in boxes], np.float64).reshape(-1, 3),
            quaternions=np.array(rotations, np.float64).reshape(-1, 4),
            colors=_colors([box.color for box in boxes]),
            labels=[box.text.encode(errors="replace").decode() for box in boxes],
        )
        self._log(f"world/{name}", entity)

    def _curves(self, result: FilterResult) -> None:
        for reason in palette.REASONS:
            self._log(f"counts/{reason.name.lower()}", self._rerun.Scalars(float(result.counts[reason])))
        if result.rings is not None:
            for name in ("thresholds", "corrections"):
                for ring, value in enumerate(getattr(result.rings, name).tolist(), 1):
                    self._log(f"{name}/ring_{ring}", self._rerun.Scalars(value))


def _shades(frame: Frame, shown: Mask) -> Bytes | None:
    """Return a grey value for each shown point, lighter for higher intensity; None without intensities."""
    if frame.intensity_name is None or not shown.any():
        return None
    intensity = frame.intensity[shown]
    low, high = np.percentile(intensity, [0, 98])
    share = ((intensity - low) / max(float(high - low), 1e-9)).clip(0, 1)
    return np.repeat((90 + 165 * share).astype(np.uint8)[:, None], 3, axis=1)


def _colors(colors: Sequence[str]) -> NDArray[np.uint32]:
    return np.array([int(color[1:] + "ff", 16) for color in colors], np.uint32)


def _blueprint(rerun: Any) -> Any:
    """Return the layout of the viewer: raw points, filtered points with boxes, and curves."""
    views = rerun.blueprint
    clouds = views.Horizontal(
        views.Spatial3DView(origin="world", contents=["+ world/raw"], name="Raw"),
        views.Spatial3DView(
            origin="world", contents=["+ world/**", "- world/raw"], name="Kept and removed points, boxes"
        ),
    )
    curves = views.Horizontal(
        views.TimeSeriesView(origin="thresholds", name="Threshold of each range ring"),
        views.TimeSeriesView(origin="counts", name="Points per frame by reason"),
    )
    return views.Blueprint(views.Vertical(clouds, curves, row_shares=[7, 3]), collapse_panels=True)


@contextmanager
def viewer(port: int) -> Iterator[Callable[[Any], None]]:
    """Start a viewer that listens only on the loopback interface and stays open; yield the sink of a `FrameStream`.

    `UsageError` if there is no display, `MissingExtraError` if rerun is not installed.
    """
    require_rerun()
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UsageError("no display found for the viewer: write a file with --save FILE.rrd")
    process = subprocess.Popen(viewer_command(port), start_new_session=True)  # noqa: S603 - fixed arguments
    try:
        yield lambda recording: recording.connect_grpc(f"rerun+http://{_LOOPBACK}:{port}/proxy")
    except BaseException:
        process.terminate()
        raise


def viewer_command(port: int) -> list[str]:
    """Return the command that starts a viewer; without ``--bind`` it would listen on all network interfaces."""
    options = ["--bind", _LOOPBACK, "--port", str(port), "--hide-welcome-screen", "--expect-data-soon"]
    return [sys.executable, "-m", "rerun_cli", *options]


def check_target(path: Path) -> None:
    """Raise `UsageError` if a file name does not end in ``.rrd``, by which viewers recognise recordings."""
    if path.suffix != ".rrd":
        raise UsageError(f"{path}: Rerun files must end in .rrd")
