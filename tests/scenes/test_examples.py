"""Training examples: split by recording, rotated without loss."""

from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.errors import InputError
from seaclutter_cli.scenes.model import top_view
from seaclutter_cli.scenes.training import Examples


def cloud(seed, size=300):
    rng = np.random.default_rng(seed)
    return rng.uniform(-85, 85, (3, size))


def examples_of(recordings):
    """Return examples of recordings, given as class and number of frames."""
    examples = Examples(("open", "confined"), 60.0)
    for number, (scene, frames) in enumerate(recordings):
        examples.begin(f"r{number}", scene)
        for frame in range(frames):
            examples.add(cloud([number, frame], 5))
    return examples


@given(st.lists(st.tuples(st.integers(0, 1), st.integers(1, 2)), min_size=1, max_size=15), st.integers(0, 5))
def test_split_by_recording(recordings, seed):
    with patch("seaclutter_cli.scenes.training.top_view", return_value=np.ones(1)):  # no split depends on images
        examples = examples_of(recordings)
    sizes = [[scene for scene, _ in recordings].count(kind) for kind in (0, 1)]
    if min(sizes) < 3:
        with pytest.raises(InputError, match="at least 3 are needed"):
            examples.split(seed)
        return
    split = examples.split(seed)
    assert sorted(np.concatenate(split).tolist()) == list(range(len(examples)))
    owners = np.repeat(np.arange(len(recordings)), [frames for _, frames in recordings])
    parts = [set(owners[part].tolist()) for part in split]
    assert not parts[0] & parts[1]
    assert not parts[1] & parts[2]
    assert not parts[0] & parts[2]
    for kind, size in enumerate(sizes):
        found = [sum(recordings[owner][0] == kind for owner in part) for part in parts]
        assert min(found) >= 1
        np.testing.assert_allclose(found, np.multiply(size, (0.6, 0.2, 0.2)), atol=1.01)


def test_the_split_depends_on_its_seed_only():
    examples = examples_of([(number % 2, 2) for number in range(30)])
    first, again, other = (examples.split(seed).test.tolist() for seed in (1, 1, 2))
    assert first == again != other


def test_an_image_without_rotation_is_the_top_view():
    examples = Examples(("open", "confined"), 60.0)
    examples.begin("r", 1)
    examples.add(cloud(1))
    np.testing.assert_array_equal(examples.image(0), top_view(cloud(1), 60.0))


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_rotation_by_90_degrees_rotates_the_image(quarters):
    examples = Examples(("open", "confined"), 60.0)
    examples.begin("r", 0)
    examples.add(cloud(2))
    np.testing.assert_array_equal(examples.image(0, quarters * np.pi / 2), np.rot90(top_view(cloud(2), 60.0), quarters))


def test_rotated_images_have_full_corners():
    side = np.linspace(-88, 88, 700)
    x, y = np.meshgrid(side, side)
    examples = Examples(("open", "confined"), 60.0)
    examples.begin("r", 0)
    examples.add(np.stack((x.ravel(), y.ravel(), np.ones(x.size))))
    assert examples.image(0, 0.7).mean() == 1


def test_empty_frames_are_left_out():
    examples = Examples(("open", "confined"), 60.0)
    examples.begin("r", 0)
    assert not examples.add(np.zeros((3, 4)))
    assert not examples.add(np.empty((3, 0)))
    assert len(examples) == 0


def test_batches_of_images():
    examples = examples_of([(0, 3), (1, 2)])
    plain = examples.images([4, 0], None)
    assert plain.shape == (2, 1, 224, 224)
    np.testing.assert_array_equal(plain[0, 0], examples.image(4))
    rotated = [examples.images([4, 0], np.random.default_rng(3)) for _ in range(2)]
    np.testing.assert_array_equal(*rotated)
    assert (rotated[0] != plain).any()
    assert examples.scenes.tolist() == [0, 0, 0, 1, 1]


@pytest.mark.parametrize("wall_deg", [0, 13, 47.3, 88])
def test_straight_lines_are_aligned_with_rows_or_columns(wall_deg):
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-55, 55, 900), np.where(rng.random(900) < 0.5, 14.0, -21.0)
    angle = np.radians(wall_deg)
    noise = rng.uniform(-50, 50, (2, 300))
    walls = np.stack((np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y))
    examples = Examples(("open", "confined"), 60.0)
    examples.begin("r", 1)
    examples.add(np.concatenate((np.concatenate((walls, noise), axis=1), np.ones((1, 1200)))))
    off_deg = np.degrees(examples.alignment_rad(0) + angle) % 90
    assert min(off_deg, 90 - off_deg) < 0.3
    image = examples.image(0, examples.alignment_rad(0))
    assert max(image.sum(axis=0).max(), image.sum(axis=1).max()) > 100


def test_a_single_cell_without_lines_can_be_rotated():
    examples = Examples(("open", "confined"), 60.0)
    examples.begin("r", 0)
    examples.add(np.array([[5.0], [5.0], [1.0]]))
    assert examples.image(0, examples.alignment_rad(0)).sum() == 1
