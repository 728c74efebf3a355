"""Detection of the sensors that sent the datagrams of a capture."""

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.catalog import ADVICE, name_unsupported
from seaclutter_cli.sensors.families import PACKET_FAMILIES
from seaclutter_cli.sensors.packets import Packets
from seaclutter_cli.sources.pcap.udp import Kind, Udp, ends
from seaclutter_cli.sources.shared.log_file import LogFile
from seaclutter_cli.sources.shared.packet_streams import MAX_CALIBRATIONS, MAX_SAMPLES, Samples
from seaclutter_cli.text import count

_TRIED_AT_ONCE, _TRIED = 4, 256
_MAX_FLOWS = 10_000
_FEW = 10


@dataclass
class Flow:
    """Datagrams of one length from one port to another; ``unsupported`` names a known sensor that is not decoded."""

    address: str
    source_port: int
    port: int
    length: int
    family: str | None = None
    count: int = 0
    samples: Samples = field(default_factory=Samples)
    unsupported: str | None = None

    @property
    def ends(self) -> str:
        """Sender and receiver as text."""
        return f"{self.address}:{self.source_port} to port {self.port}"

    def __str__(self) -> str:
        text = f"{count(self.count, 'UDP datagram')} of {count(self.length, 'byte')} from {self.ends}"
        return f"{text} ({self.unsupported}: not supported; {ADVICE})" if self.unsupported else text


@dataclass
class CapturedSensor:
    """A sensor in a capture, with a sample and ``info`` of `Samples.packets`; it ``shares`` its address with others."""

    family: str
    address: str
    port: int
    kinds: set[Kind]
    sample: Packets
    info: NDArray[np.uint8] | None = None
    shares: bool = False


class SensorSearch:
    """Search for sensors among the datagrams of a capture."""

    def __init__(self) -> None:
        self.flows: dict[Kind, Flow] = {}
        self._calibrated: set[tuple[str, str]] = set()

    def add(self, kind: Kind, packets: Packets) -> None:
        """Add datagrams of a kind to the search."""
        flow = self.flows.get(kind) or Flow(*ends(kind[0]), kind[1])
        if flow.family is None and flow.count < _TRIED:
            payloads = packets.payloads[:_TRIED_AT_ONCE]
            families = (name for name, one in PACKET_FAMILIES.items() if any(map(one.recognises, payloads)))
            flow.family = next(families, None)
            if flow.family is None:
                flow.unsupported = flow.unsupported or name_unsupported(payloads[0])
        flow.count += len(packets)
        if flow.family is not None:
            self._sample(flow, packets, flow.family)
        if flow.family is not None or len(self.flows) < _MAX_FLOWS:
            self.flows[kind] = flow

    def _sample(self, flow: Flow, packets: Packets, name: str) -> None:
        family, samples, sensor = PACKET_FAMILIES[name], flow.samples, (name, flow.address)
        searched = family.calibrates and (sensor not in self._calibrated or not samples.data)
        if len(samples.data) < MAX_SAMPLES or searched:
            samples.add(packets, family)
            if len(samples.calibrations) >= MAX_CALIBRATIONS:
                self._calibrated.add(sensor)

    def damaged_flows(self) -> list[Flow]:
        """Return flows of few packets, probably damaged ones of another flow: only address, or only length differs."""
        most: dict[tuple[str | None, int] | str, int] = defaultdict(int)
        for flow in self.flows.values():
            if flow.family is not None:
                most[flow.family, flow.length] = max(most[flow.family, flow.length], flow.count)
                most[flow.ends] = max(most[flow.ends], flow.count)
        few = [flow for flow in self.flows.values() if flow.count < _FEW and not flow.samples.calibrations]
        like = [(flow, (flow.family, flow.length) if flow.samples.data else flow.ends) for flow in few]
        return [flow for flow, key in like if flow.count * 100 < most[key]]

    def headless(self, file: LogFile, udp: Udp) -> list[tuple[Flow, int]]:
        """Return flows of sensors, each with the number of packets like its own whose headers are damaged."""
        like = {(flow.family, flow.length): flow for flow in self.flows.values() if flow.samples.data}
        found = []
        for (family, length), flow in like.items():
            if length in udp.shapes:  # not if it is sent in fragments
                size, start = udp.shapes[length]
                records = (file[at + start : at + start + length] for at, other in udp.unread if other == size)
                number = sum(PACKET_FAMILIES[family or ""].recognises(np.frombuffer(one, np.uint8)) for one in records)
                found += [(flow, number)] if number else []
        return found

    def sensors(self) -> list[CapturedSensor]:
        """Return the sensors, sorted by address, port and family."""
        groups: dict[tuple[str, str], dict[Kind, Flow]] = defaultdict(dict)
        damaged = {id(flow) for flow in self.damaged_flows()}
        for kind, flow in self.flows.items():
            if flow.family is not None and id(flow) not in damaged:
                groups[flow.address, flow.family][kind] = flow
        found = [sensor for group in groups.values() for sensor in _split(group)]
        addresses = [sensor.address for sensor in found]
        for sensor in found:
            sensor.shares = addresses.count(sensor.address) > 1
        return sorted(found, key=lambda sensor: (sensor.address, sensor.port, sensor.family))


def _split(flows: dict[Kind, Flow]) -> list[CapturedSensor]:
    """Return the sensors at one address: one for each port that receives data of the main packet length."""
    data = {kind: flow for kind, flow in flows.items() if flow.samples.data}
    by_length: dict[int, list[Kind]] = defaultdict(list)
    for kind, flow in sorted(data.items(), key=lambda item: (item[1].port, item[1].source_port)):
        by_length[flow.length].append(kind)
    if not by_length:
        return []
    main_length = max(by_length, key=lambda length: sum(data[kind].count for kind in by_length[length]) * length)
    main = by_length[main_length]
    sensors = []
    for index, first in enumerate(main):
        own = {first} | {kinds[index] for kinds in by_length.values() if len(kinds) == len(main)}
        if len(main) == 1:
            own = set(data)
        sensors.append(_sensor(first, own, flows, index, len(main)))
    return sensors


def _sensor(first: Kind, own: set[Kind], flows: dict[Kind, Flow], index: int, count: int) -> CapturedSensor:
    flow = flows[first]
    calibrating = sorted(
        (kind for kind, other in flows.items() if other.samples.calibrations),
        key=lambda kind: (flows[kind].port, flows[kind].source_port),
    )
    separate = [kind for kind in calibrating if not flows[kind].samples.data]
    if first in calibrating:
        calibrating = [first]
    elif len(separate) == count:
        calibrating = [separate[index]]
    if not index:
        own = own | set(separate)
    calibrations = [pair for kind in calibrating for pair in flows[kind].samples.calibrations]
    sample, info = Samples(flow.samples.data, calibrations).packets(flow.length)
    return CapturedSensor(flow.family or "", flow.address, flow.port, own, sample, info)
