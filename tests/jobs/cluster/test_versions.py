"""Versions that may differ between here and workers, and those that may not."""

import pytest

from seaclutter_cli.jobs.cluster.engine import compared_packages, skew, versions_question

HERE = {
    "seaclutter": "0.2.0",
    "python": "3.11.7.final.0",
    "distributed": "2026.8.0",
    "numpy": "2.1.0",
    "laspy": "2.5.4",
    "tqdm": "4.66",
}


@pytest.mark.parametrize(
    ("changes", "difference"),
    [
        ({}, None),
        ({"seaclutter": "0.1.0"}, "has seaclutter 0.1.0, here 0.2.0"),
        ({"seaclutter": None}, "has no seaclutter, here 0.2.0"),
        ({"python": "3.12.1.final.0"}, "has python 3.12, here 3.11"),
        ({"python": "3.11.9.final.0"}, None),
        ({"distributed": "2026.7.0"}, "has distributed 2026.7.0, here 2026.8.0"),
        ({"numpy": "2.0.0"}, "has numpy 2.0.0, here 2.1.0"),
        ({"numpy": None}, "has no numpy, here 2.1.0"),
        ({"laspy": "2.4.0"}, "has laspy 2.4.0, here 2.5.4"),
        ({"laspy": None}, None),
        ({"tqdm": "1.0"}, None),
    ],
)
def test_differences(changes, difference):
    assert skew({"packages": HERE}, {"packages": {**HERE, **changes}}) == difference


def test_a_scheduler_computes_nothing():
    assert skew({"packages": HERE}, {"packages": {**HERE, "numpy": None}}, of_scheduler=True) is None
    assert skew({"packages": HERE}, {"packages": {**HERE, "dask": "1", "seaclutter": None}}, of_scheduler=True)


def test_an_answer_without_versions():
    assert skew({"packages": HERE}, None) == "has no seaclutter, here 0.2.0"


def test_what_outputs_depend_on_is_compared():
    assert {"numpy", "scipy", "mcap", "zstandard", "lz4", "rosbags"} <= set(compared_packages())
    collect, packages = versions_question()
    assert not {"pytest", "matplotlib", "click"} & set(collect(packages)["packages"])
