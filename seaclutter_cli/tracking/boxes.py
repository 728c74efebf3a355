"""Boxes of tracks: orientation and size fitted over many frames, position and velocity smoothed over time."""

from dataclasses import dataclass, field

import numpy as np

from seaclutter_cli.arrays import Floats, Mask
from seaclutter_cli.tracking.detections import YAWS
from seaclutter_cli.tracking.tracker import ahead

STRUCTURE = "structure"
_TURNING_S, _STEADY_S, _STEADY = 0.7, 5.0, 0.1
_SIZE_QUANTILE = 0.9
_OBLIQUE, _BROAD = np.sin(np.radians((10, 25)))
_USUAL_BEAM, _SHIP_BEAM, _BROAD_BEAM = 0.3, 0.6, 0.35
_SAIL_THIN, _SAIL_TALL, _SAIL_SHARE = 0.2, 0.5, 0.85
_ROUND_M, _ROUND, _FINE = 2.5, 0.9, 0.04
_SMALL_CRAFT_M, _STRUCTURE_M, _WIDE_M = 12.0, 50.0, 25.0
_LEAST_WALL_M, _STRAIGHT, _UPRIGHT = 6.0, 1 / 40, 0.5
_ACCELERATIONS = (0.1, 1.0, 10.0)
_GAIN = 30.0
_SIDEWAYS = 0.7
_NOISE_M, _HIDDEN_NOISE, _BETWEEN_NOISE = 0.08, 0.3, 0.4
_SPEED_MS = 4.0
_OUTLYING = 3.0
_MAX_SIZES = 512


@dataclass
class Shape:
    """What is known of the shape of a track: extents along and across in frames so far, and its last yaw."""

    along: list[float] = field(default_factory=list)
    across: list[float] = field(default_factory=list)
    oblique: bool = False
    broad: bool = False
    yaw: float | None = None
    yaw_s: float = 0.0


def guessed_class(size: Floats, depth_m: float) -> str:
    """Return the class that the size of an object suggests, shape (3,), and the width of it that was seen.

    Quays and land are structures: larger than most vessels, or walls, which are straight where hulls curve.

    Examples
    --------
    >>> sizes = (0.8, 0.7, 1), (7, 2.5, 1), (24, 6, 4), (80, 9, 2), (49, 8, 2.5)
    >>> [guessed_class(np.array(size), depth_m) for size, depth_m in zip(sizes, (0.7, 2.5, 5, 1, 0.2))]
    ['buoy', 'small craft', 'vessel', 'structure', 'structure']
    """
    length_m, width_m, height_m = size.tolist()
    is_wall = length_m > _LEAST_WALL_M and depth_m < min(_STRAIGHT * length_m, _UPRIGHT * height_m)
    if is_wall or length_m > _STRUCTURE_M or width_m > _WIDE_M:
        return STRUCTURE
    return "buoy" if length_m <= _ROUND_M else "small craft" if length_m <= _SMALL_CRAFT_M else "vessel"


def with_hull(size: Floats) -> Floats:
    """Return the size of an object, shape (3,), with that of a usual hull if only sails are in view.

    Jib and mainsail together are shorter than the hull.

    Examples
    --------
    >>> with_hull(np.array((6.8, 0.9, 9.0))).round(1).tolist(), with_hull(np.array((6.8, 2.0, 9.0))).tolist()
    ([8.0, 2.4, 9.0], [6.8, 2.0, 9.0])
    """
    length_m, width_m, height_m = size
    if not width_m < _SAIL_THIN * length_m < _SAIL_THIN / _SAIL_TALL * height_m:
        return size
    length_m /= _SAIL_SHARE
    return np.array((length_m, _usual_beam_m(length_m), height_m))


def _usual_beam_m(length_m: float) -> float:
    return float(min(_USUAL_BEAM * length_m, _SHIP_BEAM * length_m ** (2 / 3)))


def orientation(misfits: Floats, times_s: Floats) -> Floats:
    """Return the yaws of the rectangles that fit a track best, shape (T,), smooth over time, modulo 90°.

    Misfits, shape (T, 45), are averaged over seconds where one yaw explains them nearly as well as several.
    """
    mean, wide = (_mean_over(misfits, times_s, half_s) for half_s in (_TURNING_S, _STEADY_S))
    least = _mean_over(mean.min(axis=1, keepdims=True), times_s, _STEADY_S)
    mean = np.where(wide.min(axis=1, keepdims=True) < least + _STEADY, wide, mean)
    best = mean.argmin(axis=1)
    rows = np.arange(len(mean))
    # The misfit has a kink where the sides are parallel: the lines on both sides of it meet there.
    far_left, left, right, far_right = (mean[rows, (best + step) % YAWS] for step in (-2, -1, 1, 2))
    fall, rise = left - far_left, far_right - right
    meet = (right - rise - left - fall) / np.minimum(fall - rise, -1e-9)
    offset = np.where(rise > fall, np.clip(meet, -1, 1), 0)
    return np.unwrap((best + offset) * (np.pi / 2 / YAWS), period=np.pi / 2)


def _mean_over(values: Floats, times_s: Floats, half_s: float) -> Floats:
    """Return the means of values, shape (T, n), over the times around each."""
    total = np.cumsum(np.concatenate((np.zeros_like(values[:1]), values)), axis=0)
    first, last = (np.searchsorted(times_s, times_s + side * (half_s + 1e-6)) for side in (-1, 1))
    return np.asarray((total[last] - total[first]) / (last - first)[:, None])


def extents(hulls: Floats, yaws: Floats) -> tuple[Floats, Floats]:
    """Return the least and the greatest coordinates along and across, shape (T, 2) each."""
    axes = _in_axes(hulls, yaws)
    return axes.min(axis=1), axes.max(axis=1)


def seen_depth_m(hulls: Floats, yaws: Floats) -> float:
    """Return the width of an object between its echoes."""
    low, high = extents(hulls, yaws)
    return float(np.quantile((high - low)[:, 1], _SIZE_QUANTILE))


def _in_axes(points: Floats, yaws: Floats) -> Floats:
    """Return points, shape (T, …, 2), in axes that are turned by yaws, shape (T,)."""
    (x, y), cos, sin = points.T, np.cos(yaws), np.sin(yaws)
    return np.stack((x * cos + y * sin, y * cos - x * sin)).T


def fit(
    shape: Shape, outlines: Floats, hidden: Mask, misfits: Floats, sensor: Floats, times_s: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return yaws, shape (T,), centres, (T, 2), their standard deviations, (T,), and the size, (2,), of a track.

    The frames are added to what is known of its shape. Of a side that was never seen, the length is that of a usual
    vessel, and what is shorter than 2.5 m is taken to be nearly round. Hulls taper, so in a view within 25° of the
    axis, the far end is hidden; if no view shows it, the length is at least that of a broad vessel. A face that is
    nearer than the rest of the rectangle is taken for the side of it. What is missing at an end that is hidden, shape
    (T, 2) for left and right, is there.
    """
    yaws = orientation(misfits, times_s)
    if shape.yaw is not None:
        known = np.interp(shape.yaw_s, times_s, yaws)
        yaws += np.round((shape.yaw - known) / (np.pi / 2)) * (np.pi / 2)
    low, high = extents(outlines, yaws)
    size = high - low
    fresh = times_s > shape.yaw_s if shape.yaw is not None else np.ones(len(times_s), np.bool_)
    shape.along, shape.across = (
        [*old, *new[fresh].tolist()][-_MAX_SIZES:] for old, new in zip((shape.along, shape.across), size.T, strict=True)
    )
    usual, whole = np.quantile((shape.along, shape.across), (0.5, _SIZE_QUANTILE), axis=1)
    if whole[1] > 1.1 * whole[0]:
        shape.along, shape.across = shape.across, shape.along
        usual, whole = usual[::-1], whole[::-1].copy()
        yaws = yaws + np.pi / 2
        low, high = extents(outlines, yaws)
    shape.yaw, shape.yaw_s = float(yaws[-1]), float(times_s[-1])
    distance_m = float(np.median(np.hypot(*(outlines.mean(axis=1) - sensor).T)))
    # All views show it whole, some with an echo of the water beside it.
    if _FINE * distance_m < usual[0] <= _ROUND_M and whole[0] <= 1.2 * _ROUND_M:
        whole = usual
    seen_from = _in_axes(sensor, yaws)
    shape.oblique |= bool(_is_oblique(seen_from, low, high, whole).any())
    view = (low + high) / 2 - seen_from
    far_is_hidden = np.where(view[:, 0] * view[:, 1] < 0, hidden[:, 0], hidden[:, 1])
    shape.broad |= bool(((np.abs(view[:, 1]) > _BROAD * np.hypot(*view.T)) & ~far_is_hidden).any())
    if whole[0] <= _ROUND_M:  # such as a buoy, of which the far half is hidden
        whole = np.maximum(whole, _ROUND * whole.max())
    elif not shape.oblique:
        whole[1] = max(whole[1], _usual_beam_m(whole[0]))
    if whole[0] > _ROUND_M and not shape.broad:
        whole[0] = max(whole[0], whole[1] / _BROAD_BEAM)
    middle, deviation = _placed(seen_from, low, high, whole, hidden)
    return yaws, _in_axes(middle, -yaws), deviation, whole


def _is_oblique(seen_from: Floats, low: Floats, high: Floats, size: Floats) -> Mask:
    """Return in which frames two sides of a box were in view, at 10° or more each."""
    offset = np.abs(seen_from - (low + high) / 2)
    distance = np.hypot(*offset.T)[:, None]
    return np.asarray(((offset - size / 2) > _OBLIQUE * distance).all(axis=1))


def _placed(seen_from: Floats, low: Floats, high: Floats, size: Floats, hidden: Mask) -> tuple[Floats, Floats]:
    """Return the centres along and across, shape (T, 2), and their standard deviations, shape (T,).

    A view that exceeds the size shows something else, too, such as spray.
    """
    missing = np.maximum(size - (high - low), 0)
    excess = np.maximum(high - low - size, 0)
    side = 1.0 * (seen_from < low) - (seen_from > high)
    view = (low + high) / 2 - seen_from
    left = view[:, ::-1] * (-1, 1) / np.maximum(np.hypot(*view.T), 1e-9)[:, None]
    only = 1.0 * hidden[:, :1] - hidden[:, 1:]
    side = np.where(hidden.any(axis=1, keepdims=True) & (np.abs(left) > _SIDEWAYS), only * np.sign(left), side)
    shift = side * missing / 2
    noise = np.where(side != 0, _HIDDEN_NOISE, _BETWEEN_NOISE) * missing + _BETWEEN_NOISE * excess
    return (low + high) / 2 + shift, _NOISE_M + np.hypot(*noise.T)


def smoothed(places: Floats, deviations: Floats, times_s: Floats) -> tuple[Floats, Floats]:
    """Return positions and velocities of N tracks in F frames, shape (F, N, 2), NaN before and after their life.

    ``places``, shape (F, N, 2), are measured ones, NaN where a track was not seen, with standard deviations, shape
    (F, N). Accelerations are the least that explain the track: where own ship turns, relative velocities change fast.
    """
    at, speed, best = _smoothed(places, deviations, times_s, _ACCELERATIONS[0])
    for acceleration in _ACCELERATIONS[1:]:
        other_at, other_speed, likelihood = _smoothed(places, deviations, times_s, acceleration)
        better = likelihood > best + _GAIN
        at[:, better], speed[:, better] = other_at[:, better], other_speed[:, better]
        best = np.where(better, likelihood, best)
    return at, speed


def _smoothed(
    places: Floats, deviations: Floats, times_s: Floats, acceleration: float
) -> tuple[Floats, Floats, Floats]:
    """Return positions, velocities, and the logarithm of the likelihood of each track, shape (N,).

    A Kalman filter of constant velocity runs forward, then the smoother of Rauch, Tung and Striebel back.
    """
    frames = len(places)
    seen = np.isfinite(places[..., 0])
    first, last = seen.argmax(axis=0), frames - 1 - seen[::-1].argmax(axis=0)
    at, speed, var, likelihood = _filtered(places, deviations, times_s, acceleration)
    for f in range(frames - 2, -1, -1):
        go = (first <= f) & (f < last)
        dt = times_s[f + 1] - times_s[f]
        a, v, p = (values[go] for values in _ahead(at[f], speed[f], var[f], dt, acceleration))
        place, both, velocity = var[f, go].T
        across = np.array(((place + dt * both, both), (both + dt * velocity, velocity)))
        adjugate = np.array(((p[:, 2], -p[:, 1]), (-p[:, 1], p[:, 0])))
        gain = (
            np.einsum("ijn,jkn->nik", across, adjugate)
            / np.maximum(p[:, 0] * p[:, 2] - p[:, 1] ** 2, 1e-30)[:, None, None]
        )
        change = gain @ np.stack((at[f + 1, go] - a, speed[f + 1, go] - v), axis=1)
        at[f, go] += change[:, 0]
        speed[f, go] += change[:, 1]
    over = np.arange(frames)[:, None] > last
    at[over] = speed[over] = np.nan
    return at, speed, likelihood


def _filtered(
    places: Floats, deviations: Floats, times_s: Floats, acceleration: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return positions, velocities, variances, shape (F, N, 3), and log-likelihoods of the Kalman filter."""
    frames, tracks, _ = places.shape
    seen = np.isfinite(places[..., 0])
    first = seen.argmax(axis=0)
    at, speed = np.full(places.shape, np.nan), np.full(places.shape, np.nan)
    var = np.full((frames, tracks, 3), np.nan)
    likelihood = np.zeros(tracks)
    for f in range(frames):
        born = first == f
        noise = deviations[f] ** 2
        if f:
            dt = times_s[f] - times_s[f - 1]
            a, v, p = _ahead(at[f - 1], speed[f - 1], var[f - 1], dt, acceleration)
            off = places[f] - a
            expected = p[:, 0] + noise
            # What is far off what is expected is doubtful.
            far = np.hypot(*off.T) ** 2 / (_OUTLYING**2 * expected)
            noise = np.where(far > 1, noise + (far - 1) * expected, noise)
            spread = p[:, 0] + noise
            gain = p[:, :2] / spread[:, None]
            use = seen[f] & ~born
            likelihood[use] -= (np.hypot(*off.T) ** 2 / (2 * spread) + np.log(spread))[use]
            off, gain = np.where(use[:, None], off, 0.0), np.where(use[:, None], gain, 0.0)
            at[f], speed[f] = a + gain[:, :1] * off, v + gain[:, 1:] * off
            var[f] = np.stack(
                ((1 - gain[:, 0]) * p[:, 0], (1 - gain[:, 0]) * p[:, 1], p[:, 2] - gain[:, 1] * p[:, 1]), axis=1
            )
        at[f, born], speed[f, born] = places[f, born], 0.0
        var[f, born] = np.stack((noise[born], 0 * noise[born], np.full(born.sum(), _SPEED_MS**2)), axis=1)
    return at, speed, var, likelihood


def _ahead(at: Floats, speed: Floats, var: Floats, dt: float, q: float) -> tuple[Floats, Floats, Floats]:
    """Return positions, velocities and variances after a time."""
    return at + dt * speed, speed, np.stack(ahead(var[:, 0], var[:, 1], var[:, 2], dt, q), axis=1)
