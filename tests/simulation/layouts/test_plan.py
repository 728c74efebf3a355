import numpy as np
import pytest

from seaclutter_cli.simulation.layouts.plan import Line, Plan, moor, shore


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("bend", [np.inf, 120.0, -120.0])
@pytest.mark.parametrize("axis", [0.0, 70.0])
class TestEveryLine:
    def test_the_edge_has_its_offset_from_the_axis(self, side, bend, axis):
        line = Line(15.0, axis, side, bend)
        middle = Line(0.0, axis, side, bend)
        for along in (-40.0, 0.0, 30.0):
            assert np.hypot(*np.subtract(line.at(along), middle.at(along))) == pytest.approx(15)
            assert np.hypot(*np.subtract(line.at(along, 4.0), middle.at(along))) == pytest.approx(19)
        (ahead_x, ahead_y), (x, y) = (
            np.subtract(position, middle.at(0.0)) for position in (middle.at(1.0), line.at(0.0))
        )
        assert np.sign(ahead_x * y - ahead_y * x) == side

    def test_segments_are_behind_the_edge_with_land_to_their_left(self, side, bend, axis):
        line = Line(15.0, axis, side, bend)
        position, length, heading = line.segment(10.0, 20.0, 6.0)
        water, land = np.array(line.at(15.0)), np.array(line.at(15.0, 3.0))
        np.testing.assert_allclose(position, land, atol=0.2)
        inland = np.array([-np.sin(np.radians(heading)), np.cos(np.radians(heading))])
        assert inland @ (land - water) > 2.9
        assert length == pytest.approx(10, rel=0.15)


def test_walls_form_a_facade_with_boats_in_front_of_it():
    plan = Plan(np.random.default_rng(1))
    line = Line(15.0, bend_m=100.0)
    shore(plan, line, (-50, 50), "quay_wall", 2.0)
    walls = len(plan.objects)
    assert walls >= 6
    assert sum(float(item.size_m[0]) for item in plan.objects) >= 0.85 * 100 * (1 - 15 / 100)
    moor(plan, line, (-50, 50), ("speedboat",), 1.0)
    boats = plan.objects[walls:]
    assert len(boats) > 3
    centre = np.array([0.0, 100.0])
    for boat in boats:
        assert 85 < np.hypot(*(np.array(boat.path[0]) - centre)) < 90
        assert not boat.ignore


def test_boats_keep_clear_of_each_other_and_of_own_ship():
    plan = Plan(np.random.default_rng(2))
    plan.scatter(("speedboat", "sailing_boat"), 30, 5, 60, moving=0.0)
    positions = np.array([item.path[0] for item in plan.objects])
    half = np.array([float(item.size_m[0]) / 2 for item in plan.objects])
    gaps = np.hypot(*(positions[:, None] - positions).T) - half - half[:, None]
    assert gaps[~np.eye(len(positions), dtype=bool)].min() > -0.01
    assert (np.hypot(*positions.T) - half).min() > 6.9
