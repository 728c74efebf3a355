"""Decoder for Hesai sensors."""

from collections import defaultdict
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Bytes, Indices, Ints, Mask, Rows
from seaclutter_cli.errors import InputError
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.catalog import ADVICE, name_unsupported
from seaclutter_cli.sensors.hesai.models import DUAL_MODES, MODELS, RETURN_MODES, HesaiModel, utc_ns
from seaclutter_cli.sensors.hesai.scans import FULL_CIRCLE, Scan, make_scan
from seaclutter_cli.sensors.packets import (
    EXPERIMENTAL,
    DecoderOptions,
    LossCounter,
    PacketFamily,
    PacketFrame,
    Packets,
    SensorClock,
    make_points,
    view_packets,
)

_GPS_LENGTH = 512
_NAMES = [model.name for model in MODELS]
_MAX_SLOTS = 4_000_000


class _Decoder:
    """Decoder for the packets of one Hesai sensor.

    Points are in the frame of Hesai's own drivers: y at azimuth 0, x to its right, z up. Two identical returns of a
    firing give one point. If asked for ``returns``, points have a ``return_number``.
    """

    places_end = 1 << 32

    def __init__(self, model: HesaiModel, scan: Scan, *, returns: bool) -> None:
        self.facts = SensorFacts(model.name, {"intensity": "reflectivity, 0 to 255"})
        self.facts.details |= EXPERIMENTAL if model.is_experimental else {}
        self._model, self._scan, self._numbers_returns = model, scan, returns
        self._revolutions: dict[int, list[tuple[Rows, int, int]]] = defaultdict(list)
        """Parts of incomplete revolutions: points, number of slots, and the time of the last one."""
        self._clock = SensorClock(self.facts)
        self._numbered, self._timed = LossCounter(wrap=1 << 32), LossCounter()

    def places(self, packets: Packets) -> Ints:
        """Return the numbers of data packets, shape (P,), or their times in microseconds; -1 for other packets."""
        layout = self._model.layouts.get(packets.payloads.shape[1])
        if layout is None:
            return np.full(len(packets), -1)
        data = view_packets(packets.payloads, layout)
        is_numbered = "sequence" in (layout.names or ())
        return data["sequence"].astype(np.int64) if is_numbered else utc_ns(data) // 1000 % self.places_end

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        layout = self._model.layouts.get(packets.payloads.shape[1])
        if layout is None or not len(packets):
            self.facts.bad_packets += len(packets) if packets.payloads.shape[1] != _GPS_LENGTH else 0
            return
        data = view_packets(packets.payloads, layout)
        bad = ~self._model.matches(data) | ~np.isin(data["mode"], list(RETURN_MODES))
        bad |= (data["blocks"]["azimuth"] >= FULL_CIRCLE).any(axis=1)
        self.facts.bad_packets += int(bad.sum())
        valid = np.flatnonzero(~bad)
        for part in np.split(valid, np.flatnonzero(np.diff(data["mode"][valid])) + 1):
            if len(part):
                self._decode(view_packets(packets.payloads[part], layout), packets.times_ns[part])
        yield from self._complete()

    def finish(self) -> Iterator[PacketFrame]:
        for number in sorted(self._revolutions):
            yield self._frame(number)

    def _complete(self) -> Iterator[PacketFrame]:
        for number in sorted(self._revolutions):
            if number < self._scan.done:
                yield self._frame(number)
            elif sum(slots for _, slots, _ in self._revolutions[number]) > _MAX_SLOTS:
                self._scan.skip()
                yield self._frame(number)

    def _frame(self, number: int) -> PacketFrame:
        points, _, ends_ns = zip(*self._revolutions.pop(number), strict=True)
        return PacketFrame(np.concatenate(points), max(0, *ends_ns), partial=self._scan.is_partial(number))

    def _decode(self, data: Rows, times_ns: Ints) -> None:
        """Assign the points of packets with one return mode, shape (P,), to their revolutions."""
        returns = self._returns(data)
        clock_ns = utc_ns(data)
        self._count_lost(data, clock_ns, returns)
        fired_ns = clock_ns[:, None] + self._model.firings_ns(data, returns)
        positions = self._scan.positions(data["blocks"][:, ::returns])
        numbers = self._scan.count(positions, fired_ns, data["rpm"].astype(np.int64))
        shifted_ns = fired_ns + self._clock.shifts(clock_ns, times_ns)[:, None]
        point_ns = shifted_ns[..., None] + self._model.channels_ns(data, returns)
        points, slots = self._points(data, positions, point_ns)
        for number in np.unique(numbers):
            member = numbers == number
            part = points[member.ravel()[slots]], int(np.count_nonzero(member)), int(point_ns[member].max())
            self._revolutions[int(number)].append(part)

    def _returns(self, data: Rows) -> int:
        """Return the number of returns per firing, and record the return mode."""
        mode = int(data["mode"][0])
        name = RETURN_MODES[mode]
        known = self.facts.details.setdefault("return mode", name)
        if name not in known.split("; "):
            self.facts.details["return mode"] = f"{known}; {name}"
            self.facts.warnings.append(f"the return mode changes to {name}")
        if not self._model.has_mirrors:
            self.facts.details.setdefault("rotation rate", f"{data['rpm'][0]} rpm")
        return 2 if mode in DUAL_MODES else 1

    def _count_lost(self, data: Rows, clock_ns: Ints, returns: int) -> None:
        """Count lost packets by sequence numbers, or by time differences of sensors that never pause."""
        if "sequence" in (data.dtype.names or ()):
            self._numbered.add(data["sequence"].astype(np.int64))
        elif not self._model.has_mirrors:
            self._timed.add(clock_ns, self._model.period_ns(data, returns))
        self.facts.lost_packets = self._numbered.lost + self._timed.lost

    def _points(self, data: Rows, positions: Ints, times_ns: Ints) -> tuple[Rows, Indices]:
        """Return the points of P packets with F firings, and the index of each among all P * F * C slots."""
        channels = self._model.channels
        units = data["blocks"]["units"]
        shape = (positions.size, units.shape[1] // positions.shape[1], channels)
        distances, intensities = (units[name].reshape(shape).swapaxes(1, 2) for name in ("distance", "intensity"))
        hit = np.flatnonzero(_distinct(distances, intensities, self._model.least_distance))
        slots, number = np.divmod(hit, shape[1])
        firings, channel = np.divmod(slots, channels)
        units_m = self._model.unit_m(data)[firings // positions.shape[1]]
        ranges = distances.ravel()[hit] * units_m
        angles, cosines, sines = self._scan.directions(positions.ravel(), firings, channel)
        across = ranges * cosines
        xyz, times_s = (across * np.sin(angles), across * np.cos(angles), ranges * sines), times_ns.ravel()[slots] / 1e9
        return_number = number + 1 if self._numbers_returns else None
        return make_points(xyz, intensities.ravel()[hit], channel, times_s, return_number), slots


def _distinct(distances: NDArray[np.uint16], intensities: NDArray[np.generic], least_distance: int) -> Mask:
    """Return a mask of the returns, shape (..., R), that exist and differ from the first of their firing."""
    distinct = np.asarray(distances >= least_distance)
    same = (distances[..., 1:] == distances[..., :1]) & (intensities[..., 1:] == intensities[..., :1])
    distinct[..., 1:] &= ~same
    return distinct


class Hesai(PacketFamily):
    """Supported Hesai sensors."""

    title = f"Hesai {', '.join(_NAMES)}"

    def recognises(self, payload: Bytes) -> bool:
        """Return whether a UDP payload, shape (L,), is a packet of a supported sensor."""
        return _model(payload[None]) is not None

    def decoder(self, packets: Packets, options: DecoderOptions) -> _Decoder:
        """Return a decoder for the sensor that sent these packets; `InputError` if it is not supported."""
        model = _model(packets.payloads)
        if model is None:
            if len(packets) and (name := name_unsupported(packets.payloads[0])):
                raise InputError(f"packets of a {name} are not supported; {ADVICE}")
            raise InputError(f"the packets are not from a supported Hesai sensor ({', '.join(_NAMES)})")
        returns = bool(np.isin(_matching(model, packets.payloads)["mode"], DUAL_MODES).any())
        scan, source = make_scan(model, options)
        decoder = _Decoder(model, scan, returns=returns)
        decoder.facts.details["angles"] = source
        if source == "nominal":
            decoder.facts.warnings.append(
                f"{model.name}: nominal angles are used; pass the unit's angle correction file (CSV) with --calibration"
            )
        return decoder


def _model(payloads: Bytes) -> HesaiModel | None:
    return next((model for model in MODELS if len(_matching(model, payloads))), None)


def _matching(model: HesaiModel, payloads: Bytes) -> Rows:
    data = view_packets(payloads, model.layouts.get(payloads.shape[1], next(iter(model.layouts.values()))))
    return data[model.matches(data)]
