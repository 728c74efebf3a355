"""Where own ship ends: learned on the way, by windows of frames, and used by methods with ``start_m`` auto."""

import numpy as np
import pytest

from seaclutter_cli.config import load_config
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.frame import Frame, Reason
from seaclutter_cli.structure.own_ship import OwnShip
from tests.filters.seas import MAST_M, Body, sea_log, share_kept

MAST = np.array([[-5.0, 0.07 * k, 0.08 * row - MAST_M + 0.6] for k in range(-12, 13) for row in range(20)])
"""A frame of own ship's at the stern, in several beams."""
LEARNED = 20


def with_mast(log, mast=MAST):
    """Return the frames of a log with own ship's mast in each."""
    frames = []
    for frame in log:
        xyz = np.concatenate((frame.xyz, mast))
        intensity = np.append(frame.intensity, np.full(len(mast), 50.0))
        frames.append(Frame.of_arrays(xyz, intensity, stamp_ns=frame.stamp_ns, index=frame.index))
    return frames


def sea(bodies=(), *, mast=MAST, frames=45, seed=1):
    """Return a log under way: what is abeam moves aft."""
    boats = [Body(x, side * 30, vx=-4, length=2, height=3, points=60) for x in range(-30, 70, 12) for side in (-1, 1)]
    return with_mast(sea_log(seed, [*boats, *bodies], np.arange(frames) / 10, drops=0), mast)


def learned(log, **options):
    own_ship = OwnShip(10.0, 3.0, **options)
    for frame in log:
        own_ship.add(frame)
    return own_ship


def test_the_outline_is_that_of_what_is_constant():
    own_ship = learned(sea())
    outline = own_ship.outline_m
    assert outline is not None
    azimuth = np.arange(-180, 180) + 0.5
    astern = np.abs(azimuth) > 180 - np.degrees(np.arctan2(0.9, 5))
    assert ((outline[astern] > 5.3) & (outline[astern] < 6.3)).all()
    assert (outline[np.abs(azimuth) < 160] == 3).all()


def test_it_is_known_after_twenty_frames_and_not_at_rest():
    log = sea()
    assert learned(log[: LEARNED - 1]).outline_m is None
    assert learned(log[:LEARNED]).outline_m is not None
    at_rest = [Frame.of_arrays(log[0].xyz, log[0].intensity, stamp_ns=k * 10**8) for k in range(60)]
    assert learned(at_rest).outline_m is None
    kept = learned([*log[:LEARNED], *at_rest])
    assert kept.outline_m.tolist() == learned(log[:LEARNED]).outline_m.tolist(), "rest shows nothing"
    kept.reset()
    assert kept.outline_m is None


def test_at_rest_what_is_constant_belongs_to_it_until_the_vessel_moves():
    quay = np.array([[0.1 * k, -8.0, 0.1 * row - MAST_M + 0.4] for k in range(-30, 31) for row in range(15)])
    city = np.array([[40 + 0.2 * (k % 3), 0.5 * k, row - MAST_M + 1] for k in range(-40, 40) for row in range(8)])
    drifting = Body(-2, 6, vx=2, length=1, width=1, height=2, points=60)
    still = np.concatenate((MAST, quay, city))
    log = sea([drifting], mast=still, frames=LEARNED)
    own_ship = learned(log)
    assert own_ship.is_at_rest
    assert own_ship.outline_m is None
    for frame in log:
        inside, structure = own_ship.contains(frame), own_ship.is_structure(frame, np.arange(frame.size))
        assert inside[-len(still) : -len(city)].all()
        assert structure[-len(still) : -len(city)].all()
        boat = np.hypot(frame.xyz[:, 0] - drifting.center(frame.stamp_ns / 1e9)[0], frame.xyz[:, 1] - 6) < 1
        assert boat.any()
        assert not inside[boat].any()
        assert not structure[boat].any()
    for frame in sea(frames=125)[LEARNED:]:
        own_ship.add(frame)
    assert not own_ship.contains(log[0])[-len(quay) - len(city) : -len(city)].any()


def test_without_own_ship_in_view_only_the_least_range_is_own_ship():
    assert set(learned(sea(mast=MAST[:0])).outline_m.tolist()) == {3.0}


@pytest.mark.parametrize("causal", [False, True])
def test_confirmed_keeps_a_boat_beside_own_ship_and_nothing_of_own_ship(causal):
    boat = Body(9, 6.5, vx=-1.5, length=2, width=1, height=0.9, points=40)
    method = FILTERS["confirmed"](FILTERS["confirmed"].Params(start_m="auto", causal=causal))
    log = sea([boat])
    results = [result for frame in log for result in method.process(frame)] + list(method.flush())
    assert np.nanmean([share_kept(result, boat) for result in results[LEARNED:]]) > 0.9
    for result in results:
        assert not result.keep[-len(MAST) :].any()
        assert (result.reason[-len(MAST) :] == Reason.NEAR).all()


def test_own_decks_do_not_raise_the_water():
    deck = np.array([[-x, y, 0.4 - MAST_M] for x in np.arange(5.2, 9, 0.2) for y in np.arange(-3, 3.1, 0.2)])
    levels = []
    for structure in (MAST, np.concatenate((MAST, deck))):
        method = FILTERS["confirmed"](FILTERS["confirmed"].Params(start_m="auto"))
        results = [one for frame in sea(mast=structure, frames=30) for one in method.process(frame)]
        levels.append([one.water.level_m for one in [*results, *method.flush()]])
    np.testing.assert_allclose(levels[1], levels[0], atol=0.03)


def test_echoes_at_exactly_180_degrees():
    frame = Frame.of_arrays([[-5.0, 0.0, 0.0], [-5.0, -0.0, 0.0]], [1.0, 1.0], stamp_ns=0)
    assert learned(sea()).contains(frame).all()


def test_other_methods_filter_what_is_beside_own_ship():
    log = sea([Body(0, 6, points=40)])
    auto, fixed = (FILTERS["joint"](FILTERS["joint"].Params(start_m=start_m)) for start_m in ("auto", 10.0))
    for number, frame in enumerate(log):
        one, other = auto.step(frame), fixed.step(frame)
        if number < LEARNED - 1:
            assert one.reason.tolist() == other.reason.tolist()
        beside = (frame.xyz[:, 1] > 4) & (frame.range_m < 10)
        assert (one.reason[beside] == Reason.NEAR).all() == (number < LEARNED - 1)


def test_auto_in_a_configuration():
    config = load_config(overrides=["start_m=auto"])
    assert (config.filter.start_m, config.ring_edges) == ("auto", [0.0, 25.0, 40.0, 55.0, 70.0])
    assert load_config(method="confirmed", overrides=["start_m=auto", "far=drop"]).ring_edges == config.ring_edges
    with pytest.raises(ConfigError, match='start_m: must be a number greater than or equal to 0 or "auto", got "atuo"'):
        load_config(overrides=["start_m=atuo"])
    with pytest.raises(ConfigError, match="must be greater than start_m"):
        load_config(overrides=["start_m=auto", "end_m=9", "initial_thresholds=[1]"])
