"""Scenes to simulate, and their files."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Ge, Interval, Len

from seaclutter_cli import validation
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.params import NotNegative, OneOf, Positive, Share, key
from seaclutter_cli.simulation.lidar import LIDARS, Lidar, NoiseParams
from seaclutter_cli.simulation.marine.motion import Places, Track
from seaclutter_cli.simulation.marine.physics import PhysicsParams
from seaclutter_cli.simulation.marine.sea import SeaParams
from seaclutter_cli.simulation.marine.shapes import SHAPES
from seaclutter_cli.simulation.marine.terrain import TERRAINS, TerrainParams
from seaclutter_cli.simulation.scene_file import KEYS, write_scene
from seaclutter_cli.sinks.atomic import OutputGroup

_OPTIONAL = {"noise": NoiseParams, "physics": PhysicsParams}
_SECTIONS = ("recording", *TERRAINS, "vessel", *_OPTIONAL, "objects")
Path2 = Annotated[Places, Len(1)]


@dataclass(frozen=True, kw_only=True)
class RecordingParams:
    """Parameters of a recording."""

    description: str = key("", "Description of the scene.", formerly="about")
    lidar: Annotated[str, OneOf("lidar", tuple(LIDARS))] = key("RS-LiDAR-32", "Name of a lidar.")
    frames: Annotated[int, Interval(ge=1, le=10**6)] = key(100, "Number of frames.")
    seed: Annotated[int, Ge(0)] = key(1, "Seed of all random values.")
    dropout: Share = key(0.01, "Share of the echoes that are lost.")


@dataclass(frozen=True, kw_only=True)
class MovingParams:
    """Position and motion of an object."""

    path: Path2 = key(((0.0, 0.0),), "Positions in metres in the world frame (x east, y north), one or more.")
    speed_ms: NotNegative = key(0.0, "Speed along the path.")
    heading_deg: float = key(0.0, "Heading of an object at rest, counter-clockwise from the world's x.")
    start_s: float = key(0.0, "Start time of the path.")

    @property
    def track(self) -> Track:
        """Position and heading over time."""
        return Track(self.path, self.speed_ms, self.heading_deg, self.start_s)


@dataclass(frozen=True, kw_only=True)
class VesselParams(MovingParams):
    """Own ship, or the vehicle on land, and the lidar on it."""

    length_m: Positive = key(7.0, "Size of the hull.")
    width_m: Positive = key(2.5, "Size of the hull.")
    lidar_height_m: Positive = key(2.5, "Height of the lidar above the waterline or the ground.")
    lidar_forward_m: float = key(2.5, "Distance of the lidar ahead of the vessel's centre.")
    wave_response: Share = key(
        0.6, "Share of the height and slope of waves or ground that the vessel follows, 0 to 1.", formerly="sway"
    )


@dataclass(frozen=True, kw_only=True)
class SceneObjectParams(MovingParams):
    """An object in the scene."""

    track_id: Annotated[int, Interval(ge=1, le=65534)] = key(meaning="Number in the labels; 1 to 65534.")
    class_name: str = key("", "Class in the labels; by default the shape.")
    shape: Annotated[str, OneOf("shape", tuple(SHAPES))] = key(meaning="Name of a shape.")
    size_m: Annotated[tuple[Positive, ...], Len(3, 3)] = key(
        meaning="Length, width and height above the waterline or the ground."
    )
    reflectivity: Share = key(0.5, "Reflectivity of the brightest parts at normal incidence.")
    wave_response: Share = key(
        1.0, "Share of the waves' height and slope that the object follows, 0 to 1.", formerly="sway"
    )
    ignore: bool = key(False, "Whether it is an area to ignore (land, a pier) instead of a target.")


@dataclass(frozen=True)
class Scene:
    """A scene to simulate: sea or ground, own ship or the vehicle, and all other objects.

    Without ``noise``, false returns are those of the lidar; without ``physics``, the sea is the simple one.
    """

    recording: RecordingParams
    terrain: TerrainParams
    vessel: VesselParams
    objects: tuple[SceneObjectParams, ...]
    noise: NoiseParams | None = None
    physics: PhysicsParams | None = None

    @property
    def lidar(self) -> Lidar:
        """The lidar at its rate."""
        lidar, rate_hz = LIDARS[self.recording.lidar], self.physics.rate_hz if self.physics else None
        if not rate_hz:
            return lidar
        columns = round(lidar.columns * lidar.rate_hz / rate_hz)  # the rate of shots stays
        return replace(lidar, rate_hz=rate_hz, columns=columns)

    def with_recording(self, **changes: Any) -> "Scene":
        """Return the scene with other frames, seed or lidar; None keeps a value. Raises `ConfigError`."""
        given = {name: value for name, value in changes.items() if value is not None}
        values, problems = {**validation.plain(self.recording), **given}, list[str]()
        recording = validation.build(RecordingParams, values, "", "recording", problems)
        if problems:
            raise ConfigError(problems[0].removeprefix("."))
        return replace(self, recording=recording)

    @property
    def sections(self) -> Mapping[str, Any]:
        """Parameters of each section of a file, without objects."""
        terrain = next(name for name, kind in TERRAINS.items() if isinstance(self.terrain, kind))
        parts: dict[str, Any] = {"recording": self.recording, terrain: self.terrain, "vessel": self.vessel}
        return parts | {name: value for name in _OPTIONAL if (value := getattr(self, name)) is not None}

    def as_dict(self) -> dict[str, Any]:
        """Return the scene as the content of a file, with default values."""
        return {**validation.plain(self.sections), "objects": [validation.plain(item) for item in self.objects]}


def builtin_scenes() -> Mapping[str, Path]:
    """Return the built-in scenes by name."""
    return validation.builtin_files("scenes")


def load_scene(name: str) -> Scene:
    """Return the scene in a file, or a built-in one by its name; raises `ConfigError` with all problems."""
    path = validation.find_file(name, "scenes", "scene file")
    return parse_scene(validation.read_yaml(path, _SECTIONS), str(path))


def save_scene(scene: Scene, path: Path, group: OutputGroup | None = None) -> None:
    """Write a scene to a file for `load_scene`, with default values and a comment for every key."""
    absent = {"noise": scene.lidar.noise, "physics": PhysicsParams()}
    absent = {name: value for name, value in absent.items() if getattr(scene, name) is None}
    write_scene(path, group, scene.sections, {"objects": (SceneObjectParams, scene.objects)}, absent)


def parse_scene(raw: Mapping[str, Any], where: str) -> Scene:
    """Return the scene that a mapping describes; error messages start with ``where``."""
    problems = [f"{key}: unknown section; allowed: {', '.join(_SECTIONS)}" for key in raw if key not in _SECTIONS]
    chosen = [name for name in TERRAINS if name in raw] or [next(iter(TERRAINS))]
    if len(chosen) > 1:
        problems.append(f"{' and '.join(chosen)}: a scene can have only one of these sections")
    kinds: dict[str, type[Any]] = {"recording": RecordingParams, chosen[0]: TERRAINS[chosen[0]], "vessel": VesselParams}
    kinds |= {name: kind for name, kind in _OPTIONAL.items() if name in raw}
    if "physics" in raw and TERRAINS[chosen[0]] is not SeaParams:
        problems.append("physics: only a sea can have this section")
    parts = validation.build_sections(kinds, raw, problems)
    objects = validation.build_list(SceneObjectParams, raw.get("objects") or [], "objects", problems)
    uses = Counter(item.track_id for item in objects)
    problems += [f"objects: track_id {number} is used more than once" for number in sorted(uses) if uses[number] > 1]
    validation.raise_problems(where, problems, KEYS)
    parts["terrain"] = parts.pop(chosen[0])
    return Scene(**parts, objects=tuple(objects))
