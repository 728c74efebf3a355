"""Configurations: all problems are reported at once, and valid configurations are read back unchanged."""

from dataclasses import fields, replace
from pathlib import Path

import pytest
import yaml

from seaclutter_cli.config import load_config
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.validation import builtin_files, find_file


@pytest.fixture
def load(tmp_path):
    def load_text(text, **options):
        path = tmp_path / "config.yaml"
        path.write_text(text)
        return load_config(path, **options)

    return load_text


def problems(load, text, **options):
    with pytest.raises(ConfigError) as caught:
        load(text, **options)
    return str(caught.value).splitlines()


def test_defaults_are_those_of_the_paper():
    assert load_config().as_dict() == {
        "filter": {
            "method": "joint",
            "start_m": 10.0,
            "end_m": 70.0,
            "near": "drop",
            "far": "keep",
            "exclude_boxes": [],
            "exclude_polygons": [],
            "mask": "",
            "ring_width_m": 15.0,
            "initial_thresholds": [30, 16, 7, 4],
            "max_neighbors": 30,
            "neighbor_fraction": 0.1,
            "std_ratio": 1.0,
            "outlier_stage": "sor",
            "outlier_radius_ratio": None,
            "outlier_min_neighbors": None,
            "update_weight": 0.6,
        },
        "evaluation": {
            "cluster_tolerance_m": 1.5,
            "min_cluster_points": 5,
            "clustering": "euclidean",
            "dbscan_min_points": 5,
            "box_margin_m": 0.5,
            "min_visible_points": 5,
        },
    }


@pytest.mark.parametrize("method", FILTERS)
def test_every_key_is_documented(method):
    config = load_config(method=method)
    lines = config.to_yaml(comments=True).splitlines()
    for field in fields(config.filter):
        assert any(line.strip().startswith(f"{field.name}:") and " # " in line for line in lines)


def test_file_beats_default_and_command_line_beats_file(load):
    text = "filter: {start_m: 5, end_m: 65}\n"
    assert load(text).filter.start_m == 5
    config = load(text, overrides=["filter.start_m=2.5", "filter.end_m=62.5", "evaluation.box_margin_m=1"])
    assert (config.filter.start_m, config.filter.end_m, config.evaluation.box_margin_m) == (2.5, 62.5, 1)


def test_another_method_takes_the_keys_it_has_too(load):
    config = load("filter: {start_m: 5, end_m: 65, update_weight: 0.5}\n", method="global_intensity")
    assert config.method == "global_intensity"
    assert config.filter.start_m == 5


def test_a_key_without_a_section_is_one_of_the_method():
    assert load_config(overrides=["start_m=5", "initial_thresholds=[1, 2, 3, 4, 5]"]).filter.start_m == 5
    with pytest.raises(ConfigError, match=r"filter.strat_m: unknown key; did you mean 'start_m'"):
        load_config(overrides=["strat_m=5"])


def test_keys_of_the_method_before_are_one_problem(load):
    text = load_config().to_yaml().replace("method: joint", "method: confirmed\n  colour: red")
    lines = problems(load, text)
    assert len(lines) == 3
    assert "max_neighbors, neighbor_fraction, std_ratio" in lines[1]
    assert "keys of joint, not of confirmed; remove them, or write method: joint and use -m confirmed" in lines[1]


def test_all_problems_are_reported_at_once(load, tmp_path):
    text = """
    filter: {start_m: -3, end_m: x, colour: red, update_weight: 1.5, near: maybe, initial_thresholds: [1, a]}
    evaluation: {min_cluster_points: 2.5}
    fliter: {}
    """
    lines = problems(load, text)
    assert lines[0] == f"{tmp_path / 'config.yaml'}: 8 problems"
    reported = " ".join(lines[1:])
    for key in (
        "fliter: unknown section",
        "filter.colour: unknown key",
        'filter.start_m: must be a number greater than or equal to 0 or "auto", got -3',
        'filter.end_m: must be a number greater than 0, got "x"',
        "filter.update_weight: must be a number from 0 to 1, got 1.5",
        'filter.near: must be "drop" or "keep", got "maybe"',
        'filter.initial_thresholds.1: must be a number, got "a"',
        "evaluation.min_cluster_points: must be a whole number greater than or equal to 1, got 2.5",
    ):
        assert key in reported


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("filter: {ring_width_m: 20}", "initial_thresholds: expected 3 (10 to 70 m in range rings of 20 m), got 4"),
        ("filter: {start_m: 80}", "end_m (70) must be greater than start_m (80)"),
        ("filter: {ring_width_m: 0.001}", "gives 60000 range rings; the maximum is 250"),
        ("filter: {ring_width_m: 1.0e-308}", "gives inf range rings; the maximum is 250"),
        ("filter: {end_m: 1.0e+300}", "gives 6.66666666667e+298 range rings; the maximum is 250"),
        ("filter: {exclude_boxes: [[2, 1, 0, 1, 0, 1]]}", "box 1 has a minimum greater than its maximum"),
        ("filter: {exclude_boxes: [[1, 2, 3]]}", "exclude_boxes.0: must be a list of 6 values"),
        ("filter: {method: magic}", "unknown method 'magic'; allowed: joint"),
        ("filter: {method: sor, update_weight: 0.5}", "unknown key; allowed for method sor: neighbors, std_ratio"),
        ("filter: {start_m: true}", 'must be a number greater than or equal to 0 or "auto", got true'),
        ("filter: {start_m: '5'}", 'must be a number greater than or equal to 0 or "auto", got "5"'),
        ("filter: {start_m: .nan}", "must be a finite number"),
        ("filter: {end_m: .inf}", "must be a finite number"),
        ("filter: {initial_thresholds: []}", "initial_thresholds: must be a list of at least 1 value, got []"),
        ("filter: {start_m: 1, start_m: 2}", "duplicate key 'start_m'"),
        ("filter: 3", "filter: must be a section with keys, got a number"),
        ("- 1", "must contain sections (filter, evaluation, sensor), got a list"),
        ("a: [", "line 1, column 5: not valid YAML"),
    ],
)
def test_one_problem(load, text, message):
    assert message in " ".join(problems(load, text))


@pytest.mark.parametrize("override", ["filter.start_m", "paint.colour=3", "filter.start_m=[1"])
def test_an_invalid_override(override):
    with pytest.raises(ConfigError, match="--set"):
        load_config(overrides=[override])


ADAPTIVE = "filter: {method: adaptive_radius, "


class TestPresets:
    def test_presets_override_the_defaults_key_by_key(self, load):
        config = load(ADAPTIVE + "presets: {open: {min_neighbors: 9}, dense: {radius_ratio: 1, min_neighbors: 2}}}")
        assert list(config.filter.presets) == ["open", "confined", "dense"]
        usual = load_config(method="adaptive_radius").filter.presets
        assert config.filter.presets["confined"] == usual["confined"]
        assert config.filter.presets["open"] == replace(usual["open"], min_neighbors=9)
        assert vars(config.filter.presets["dense"]) == {"radius_ratio": 1, "min_neighbors": 2}

    def test_the_command_line_overrides_the_file(self, load):
        text = ADAPTIVE + "presets: {open: {min_neighbors: 9, radius_ratio: 0.5}}}"
        (preset, *_) = load(text, overrides=["filter.presets.open.radius_ratio=0.25"]).filter.presets.values()
        assert vars(preset) == {"radius_ratio": 0.25, "min_neighbors": 9}

    def test_each_preset_is_on_one_line(self):
        lines = load_config(method="adaptive_radius").to_yaml().splitlines()
        index = lines.index("  presets:")
        assert [line.split(": {radius_ratio: ")[0] for line in lines[index + 1 : index + 3]] == [
            "    open",
            "    confined",
        ]

    @pytest.mark.parametrize(
        ("keys", "message"),
        [
            ("presets: 3", "filter.presets: must be a section with keys, got a number"),
            ("presets: [1]", "filter.presets: must be a section with keys, got a list"),
            ("presets: {open: 3}", "filter.presets.open: must be a section with keys, got a number"),
            ("presets: {open: null}", "filter.presets.open: must be a section with keys, got nothing"),
            ("presets: {1: {}}", "filter.presets.1: the name must be text, got a number"),
            ("presets: {open: {radius_ratio: -1}}", "presets.open.radius_ratio: must be a number greater than 0"),
            ("presets: {open: {min_neighbors: 0}}", "presets.open.min_neighbors: must be a whole number greater than"),
            ("presets: {open: {K: 1}}", "presets.open.K: unknown key; allowed for each entry: radius_ratio, min_"),
            ("presets: {dense: {radius_ratio: 1}}", "filter.presets.dense.min_neighbors: is missing"),
            ("presets: {auto: {radius_ratio: 1, min_neighbors: 1}}", "presets.auto: the name auto is reserved"),
            ("scene: lock", "scene: must be one of open, confined, auto, got"),
        ],
    )
    def test_problems_are_reported(self, load, keys, message):
        assert message in " ".join(problems(load, f"{ADAPTIVE}{keys}}}"))

    def test_all_problems_are_reported_at_once(self, load):
        lines = problems(load, ADAPTIVE + "scene: 3, presets: {open: {a: 1, min_neighbors: x}, b: {}}}")
        assert "5 problems" in lines[0]


def test_keys_of_one_outlier_stage_are_rejected_with_the_other(load):
    assert "outlier_radius_ratio: valid only with outlier_stage" in " ".join(
        problems(load, "filter: {outlier_radius_ratio: 0.1}")
    )
    assert load("filter: {outlier_stage: adaptive_radius}").as_dict()["filter"]["outlier_min_neighbors"] > 0


def test_an_unreadable_file(tmp_path):
    with pytest.raises(ConfigError, match="no such file; built-in ones: "):
        load_config(tmp_path / "none.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="cannot be read"):
        load_config(tmp_path / "binary.yaml")
    with pytest.raises(ConfigError, match="cannot be read"):
        load_config(tmp_path)


def test_an_empty_file_is_all_defaults(load):
    assert load("") == load_config() == load("# nothing\nfilter:\n")


@pytest.mark.parametrize("path", builtin_files().values(), ids=lambda path: path.stem)
def test_built_in_configs_are_valid_and_found_by_name(path):
    assert find_file(path.stem, "", "file") == find_file(path.name, "", "file") == path
    assert load_config(path).method in FILTERS


def test_the_built_in_config_of_the_papers_sensor_is_the_default():
    assert load_config(Path("rs-lidar-32")).filter == load_config().filter


def test_yaml_output_is_plain_yaml():
    config = load_config()
    assert yaml.safe_load(config.to_yaml()) == config.as_dict()
