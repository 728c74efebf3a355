"""The scene classifier: top views of frames, trained networks as ONNX files, and the scene of each frame."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Bytes, Floats
from seaclutter_cli.documents import load_json
from seaclutter_cli.errors import ModelError, requiring
from seaclutter_cli.frame import Frame
from seaclutter_cli.paths import open_regular
from seaclutter_cli.text import printable
from seaclutter_cli.threads import waited

IMAGE_SIZE = 224
"""Number of rows, and of columns, of a top view."""

CLASSES_KEY = "seaclutter.classes"
EXTENT_KEY = "seaclutter.extent_m"
"""Metadata keys: a JSON list of class names in the order of the outputs; half the side of the square."""

_IMAGE_SHAPE = [1, IMAGE_SIZE, IMAGE_SIZE]
_MAX_BYTES = 2**26
_MOST_S, _MOST_WORK_BYTES = 60.0, 2**29


def top_view(xyz: Floats, extent_m: float, size: int = IMAGE_SIZE) -> Bytes:
    """Return the top view of a frame: the cells of a square around the lidar that contain a point.

    Coordinates, shape (3, N), are in metres; x points forward, which is up in the image, y to the left. The image,
    shape (size, size), uint8, of an even size, is 1 where there is a point, otherwise 0; the upper and the left edge of
    a cell belong to it. Points with a coordinate that is not finite, and points exactly at the origin, are not returns
    and are ignored.

    This is the binary image of [Bi] (point cloud to image converter). It is computed in single precision, which may
    shift the edge of a cell by some micrometres.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        row, column = (np.float32(extent_m) - xyz[:2].astype(np.float32)) * np.float32(size / (2 * extent_m))
        inside = (np.minimum(row, column) >= 0) & (np.maximum(row, column) < size)  # False where either is NaN
    inside &= np.isfinite(xyz[2]) & xyz.any(axis=0)
    image = np.zeros((size, size), np.uint8)
    image[row[inside].astype(np.int32), column[inside].astype(np.int32)] = 1
    return image


class SceneModel:
    """A scene classifier, run by onnxruntime on one thread; the same image gives the same probabilities.

    It is read from an ONNX file, or has the name of a built-in model. It knows the names of its ``classes``, and
    ``extent_m``, half the side of the square in the top view.

    `MissingExtraError` if onnxruntime is not installed; `ModelError` if the file does not exist, or is no scene
    classifier.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        with requiring("the scene classifier", "scene"):
            import onnxruntime as runtime
        data = _read(name)
        _limit_memory()
        self._options = runtime.RunOptions
        options = runtime.SessionOptions()
        options.add_session_config_entry("session.use_env_allocators", "1")
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4  # errors are raised instead
        try:
            self._session = runtime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime's errors have no class in common
            raise ModelError(f"{name}: not a usable ONNX file ({_first_line(error)})") from error
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        if len(inputs) != 1 or len(outputs) != 1:
            raise self._error(f"expected one input and one output, got {len(inputs)} and {len(outputs)}")
        kind, shape = inputs[0].type, list(inputs[0].shape)
        if kind != "tensor(uint8)" or shape[1:] != _IMAGE_SHAPE or shape[0] not in (None, 1, "N"):
            raise self._error(f"its input is {kind} of {shape}, expected images of {IMAGE_SIZE} by {IMAGE_SIZE} bytes")
        self._input = str(inputs[0].name)
        self.classes, self.extent_m = self._check_metadata()
        self._check_run()

    def probabilities(self, image: Bytes) -> NDArray[np.float32]:
        """Return the probability of each class, shape (C,), for a `top_view`, shape (224, 224)."""
        out: NDArray[np.float32] = self._run(image)[0]
        return out

    def _run(self, image: Bytes) -> Any:
        """Return the output for an image; a model may loop without an end, which no interrupt of Python reaches."""
        options = self._options()
        try:
            return waited(lambda: self._session.run(None, {self._input: image[None, None]}, options)[0], _MOST_S)
        except TimeoutError:
            raise self._error(f"it takes more than {_MOST_S:g} s for an image") from None
        finally:
            options.terminate = True

    def _check_metadata(self) -> tuple[tuple[str, ...], float]:
        try:
            metadata = self._session.get_modelmeta().custom_metadata_map
        except UnicodeDecodeError as error:
            raise self._error("its metadata are not valid text") from error
        if missing := [key for key in (CLASSES_KEY, EXTENT_KEY) if key not in metadata]:
            raise self._error(f"its metadata lacks {' and '.join(missing)}")
        try:
            classes, extent_m = load_json(metadata[CLASSES_KEY]), float(metadata[EXTENT_KEY])
        except ValueError as error:
            raise self._error(f"its metadata cannot be read: {_first_line(error)}") from error
        names = classes if isinstance(classes, list) and all(isinstance(item, str) for item in classes) else []
        if len(names) < 2 or len(set(names)) < len(names) or not all(names):
            raise self._error("its metadata must list two or more different class names")
        if not 0 < extent_m < math.inf:
            raise self._error(f"the extent in its metadata must be positive and finite, got {extent_m} m")
        return tuple(names), extent_m

    def _check_run(self) -> None:
        try:
            out = self._run(np.zeros((IMAGE_SIZE, IMAGE_SIZE), np.uint8))
        except ModelError:
            raise
        except Exception as error:
            raise self._error(f"it does not run: {_first_line(error)}") from error
        expected = (1, len(self.classes))
        if not isinstance(out, np.ndarray) or out.shape != expected or out.dtype != np.float32:
            raise self._error(f"its output is not {len(self.classes)} probabilities")
        if not (np.all(out >= 0) and abs(float(out.sum()) - 1) < 1e-3):
            raise self._error("its output is not a probability distribution")

    def _error(self, why: str) -> ModelError:
        return ModelError(f"{self.name}: not a seaclutter scene classifier; {printable(why)}")


@cache
def _limit_memory() -> None:
    """Limit the memory of all values that models compute, which their files can declare as they like."""
    import onnxruntime as runtime

    place = runtime.OrtMemoryInfo("Cpu", runtime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, runtime.OrtMemType.DEFAULT)
    runtime.create_and_register_allocator(place, runtime.OrtArenaCfg({"max_mem": _MOST_WORK_BYTES}))


def builtin_models() -> dict[str, Path]:
    """Return the paths of the built-in models by name."""
    return {path.stem: path for path in sorted(Path(__file__).parent.glob("*.onnx"))}


def _read(name: str) -> bytes:
    path = Path(name) if Path(name).is_file() else builtin_models().get(name, Path(name))
    try:
        with open_regular(path) as file:
            data = file.read(_MAX_BYTES + 1)
    except OSError as error:
        builtin = ", ".join(builtin_models()) or "none"
        raise ModelError(f"{path}: cannot be read ({error.strerror}); built-in models: {builtin}") from error
    if len(data) > _MAX_BYTES:
        raise ModelError(f"{path}: larger than {_MAX_BYTES // 2**20} MB; not a seaclutter scene classifier")
    return data


def _first_line(error: Exception) -> str:
    return printable((str(error).strip() or type(error).__name__).splitlines()[0])


@dataclass(frozen=True)
class SceneDecision:
    """The scene of a frame, and the probabilities of all classes in the latest classification.

    Unless this frame was classified itself, the decision is carried over from an earlier one.
    """

    name: str
    decided: bool
    probabilities: Mapping[str, float]


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
        self._decision = SceneDecision(self.classes[0], False, even)
        self._wait = 0
        self._rival, self._rival_count = self.classes[0], 0

    def scene(self, frame: Frame) -> SceneDecision:
        """Return the scene of a frame; called once for each frame, in order."""
        if self._wait:
            self._wait -= 1
        elif (image := top_view(frame.coordinates, self._model.extent_m)).any():
            self._wait = self._every - 1
            return self._decide(dict(zip(self.classes, self._model.probabilities(image).tolist(), strict=True)))
        return replace(self._decision, decided=False)

    def _decide(self, probabilities: dict[str, float]) -> SceneDecision:
        most_probable = max(probabilities, key=lambda name: probabilities[name])
        name = self._decision.name
        self._rival_count = self._rival_count + 1 if most_probable == self._rival else 1
        self._rival = most_probable
        if not self._decision.decided or self._rival_count >= self._hold:
            name = most_probable
        self._decision = SceneDecision(name, True, probabilities)
        return self._decision
