"""Properties that every filter must have; these tests apply to each entry of `FILTERS`."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.cloud import from_array
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.frame import Reason
from tests.filters.frames import big_endian, frame_of, make_frame, organised, sea_frame, take

KEEPS_INVALID = {"none"}
LOOKS_DOWN = {"sea_surface", "confirmed", "patchwork"}
HAS_SECTORS = {"patchwork"}
KNOWS_THE_SEA = {"confirmed"}
RINGS = {"joint": 4, "confirmed": 4, "ring_intensity": 4, "ring_intensity_outlier": 4, "global_intensity": 1}

pytestmark = pytest.mark.parametrize("name", FILTERS)


def make(name, **params):
    return FILTERS[name](FILTERS[name].Params(**params))


def run(method, frames):
    """Return the results of a recording, after a first pass if the method needs one."""
    if method.needs_first_pass:
        for frame in frames:
            method.observe(frame)
    return [method.step(frame) for frame in frames]


def reasons(method, frames):
    return [result.reason.tolist() for result in run(method, frames)]


def sea(seed=2, count=3, **kwargs):
    return [sea_frame(seed, index=index, **kwargs) for index in range(count)]


def test_params_are_frozen_and_have_defaults(name):
    params = FILTERS[name].Params()
    assert dataclasses.is_dataclass(params)
    assert params == FILTERS[name].Params()
    for field in dataclasses.fields(params):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(params, field.name, None)


def test_one_reason_per_point(name):
    for frame, result in zip(sea(), run(make(name), sea()), strict=True):
        assert result.reason.shape == (frame.size,)
        assert result.reason.dtype == np.uint8
        assert set(result.reason.tolist()) <= set(Reason)
        assert result.counts.sum() == frame.size


def test_the_result_refers_to_the_input_frame(name):
    frames = sea()
    assert all(result.frame is frame for frame, result in zip(frames, run(make(name), frames), strict=True))


def test_results_are_not_modified_later(name):
    """Later frames must not change earlier results."""
    frames = sea()
    method = make(name)
    earlier = run(method, frames)
    copies = [result.reason.copy() for result in earlier]
    rings = [dataclasses.astuple(result.rings) if result.rings else () for result in earlier]
    rings = [[values.copy() for values in one] for one in rings]
    run(method, sea(seed=3))
    for result, reason, values in zip(earlier, copies, rings, strict=True):
        np.testing.assert_array_equal(result.reason, reason)
        later = dataclasses.astuple(result.rings) if result.rings else ()
        for now, before in zip(later, values, strict=True):
            np.testing.assert_array_equal(now, before)


def test_rings_add_up(name):
    for result in run(make(name), sea()):
        assert (result.rings is not None) == (name in RINGS)
        if result.rings is None:
            continue
        *values, beyond = dataclasses.astuple(result.rings)
        assert {one.shape for one in values} == {(RINGS[name],)}
        assert [one.dtype for one in (*values, beyond)] == ["f8", "f8", "i8", "i8", "i8", "i8"]
        far = result.frame.valid & (result.frame.range_m >= 70)
        assert beyond.tolist() == [far.sum(), (far & result.keep).sum()]
        inside = result.frame.valid & (result.frame.range_m >= 10) & (result.frame.range_m < 70)
        assert result.rings.points.sum() == inside.sum()
        # Methods that also remove points beyond the range rings count those in the rings.
        counts = np.bincount(result.reason[inside], minlength=len(Reason)) if name in KNOWS_THE_SEA else result.counts
        assert result.rings.low_intensity.sum() == counts[Reason.LOW_INTENSITY]
        assert result.rings.outliers.sum() == counts[Reason.OUTLIER] + counts[Reason.UNCONFIRMED]


def test_reset_is_like_new(name):
    method = make(name)
    run(method, sea(seed=7))
    method.reset()
    assert reasons(method, sea()) == reasons(make(name), sea())


def test_two_filters_share_no_state(name):
    """Two topics of one recording are filtered in alternation."""
    first, second = make(name), make(name)
    for frame, other in zip(sea(), sea(seed=7), strict=True):
        if first.needs_first_pass:
            first.observe(frame)
            second.observe(other)
    both = [(first.step(a).reason.tolist(), second.step(b)) for a, b in zip(sea(), sea(seed=7), strict=True)]
    assert [reason for reason, _ in both] == reasons(make(name), sea())


def test_the_bytes_of_the_cloud_do_not_change(name):
    frames = sea()
    before = [bytes(frame.cloud.data) for frame in frames]
    run(make(name), frames)
    assert [bytes(frame.cloud.data) for frame in frames] == before


@pytest.mark.parametrize("size", [0, 1])
def test_frames_with_no_or_one_point(name, size):
    frame = make_frame(np.full((size, 3), 20.0), 100)
    (result,) = run(make(name, **({"threshold": 5.0} if name == "global_intensity" else {})), [frame])
    assert result.reason.shape == (size,)
    assert result.reason.dtype == np.uint8


def test_empty_frames_within_a_recording(name):
    frames = [make_frame([], [], index=0), *sea(), make_frame([], [], index=4)]
    assert [len(reason) for reason in reasons(make(name), frames)] == [frame.size for frame in frames]


@pytest.mark.parametrize("bad", [math.nan, 0.0], ids=["nan", "zero"])
def test_only_invalid_points(name, bad):
    frame = make_frame(np.full((50, 3), bad), 100)
    expected = Reason.KEPT if name in KEEPS_INVALID else Reason.INVALID
    assert reasons(make(name), [frame]) == [[expected] * 50]


def test_exactly_the_invalid_points_have_that_reason(name):
    for result in run(make(name), sea()):
        invalid = np.zeros(result.frame.size, bool) if name in KEEPS_INVALID else ~result.frame.valid
        np.testing.assert_array_equal(result.reason == Reason.INVALID, invalid)


@pytest.mark.parametrize("layout", [big_endian, lambda frame: organised(frame, height=4, padding=7)])
def test_layout_of_the_bytes_does_not_matter(name, layout):
    frames = sea(intensities="u1", size=400)
    assert {frame.size % 4 for frame in frames} == {0}
    assert reasons(make(name), [layout(frame) for frame in frames]) == reasons(make(name), frames)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_order_of_the_points_does_not_matter(name, seed):
    frames = sea(seed, 2, size=200, intensities="u1")
    rng = np.random.default_rng(seed)
    orders = [rng.permutation(frame.size) for frame in frames]
    shuffled = reasons(make(name), [take(frame, order) for frame, order in zip(frames, orders, strict=True)])
    expected = [np.array(r)[order].tolist() for r, order in zip(reasons(make(name), frames), orders, strict=True)]
    assert shuffled == expected


def moved(frame, xyz_of):
    """Return the frame with coordinates computed from x, y and z."""
    points = frame.cloud.points.copy()
    for axis, values in zip("xyz", xyz_of(*(frame.cloud.points[axis] for axis in "xyz")), strict=True):
        points[axis] = values
    return frame_of(from_array(points), frame.index)


@pytest.mark.parametrize("factor", [0.25, 8.0])
def test_unit_of_length_does_not_matter(name, factor):
    """Config keys ending in ``_m`` are lengths, those ending in ``_per_m`` are reciprocal lengths.

    A factor that is a power of two changes no digits.
    """
    if name in KNOWS_THE_SEA:
        pytest.skip("the method knows sizes of waves, wakes and boats, which no key sets")
    params = {
        field.name: getattr(FILTERS[name].Params(), field.name) * (1 / factor if "_per_m" in field.name else factor)
        for field in dataclasses.fields(FILTERS[name].Params)
        if field.name.endswith("_m") and getattr(FILTERS[name].Params(), field.name) is not None
    }
    scaled = [moved(frame, lambda x, y, z: (factor * x, factor * y, factor * z)) for frame in sea(coordinates="f8")]
    assert reasons(make(name, **params), scaled) == reasons(make(name), sea(coordinates="f8"))


@pytest.mark.parametrize("factor", [0.5, 4.0])
def test_unit_of_intensity_does_not_matter(name, factor):
    fields = {field.name for field in dataclasses.fields(FILTERS[name].Params)}
    params = {}
    if "intensity_threshold" in fields:
        params["intensity_threshold"] = factor * FILTERS[name].Params().intensity_threshold
    if "initial_thresholds" in fields:
        params["initial_thresholds"] = tuple(factor * value for value in FILTERS[name].Params().initial_thresholds)
    scaled = sea()
    for index, frame in enumerate(scaled):
        points = frame.cloud.points.copy()
        points["intensity"] *= factor
        scaled[index] = frame_of(from_array(points), index)
    assert reasons(make(name, **params), scaled) == reasons(make(name), sea())


@pytest.mark.parametrize(
    "rotation",
    [lambda x, y, z: (-y, x, z), lambda x, y, z: (x, -y, z), lambda x, y, z: (x, y, -z)],
    ids=["quarter rotation", "mirrored", "upside down"],
)
def test_heading_does_not_matter(name, rotation, request):
    if name in LOOKS_DOWN and "upside down" in request.node.callspec.id:
        pytest.skip("the method depends on the upward direction")
    if name in HAS_SECTORS:
        pytest.skip("the method divides the frame into sectors, which do not turn with the vessel")
    assert reasons(make(name), [moved(frame, rotation) for frame in sea()]) == reasons(make(name), sea())


def test_number_of_threads_does_not_matter(name, monkeypatch):
    frames = sea(seed=4, count=2, size=20_000)
    found = []
    for threads in (1, 2, 3):
        monkeypatch.setenv("SEACLUTTER_THREADS", str(threads))
        found.append(reasons(make(name), frames))
    assert found[0] == found[1] == found[2]
