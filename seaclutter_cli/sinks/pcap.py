"""Records of packet captures with UDP packets: classic PCAP over Ethernet."""

import struct

_MAGIC_NS = 0xA1B23C4D
_ETHERNET, _SNAP = 1, 262144
_DONT_FRAGMENT = 0x4000
_SOURCE, _TARGET = bytes((192, 168, 1, 200)), bytes((192, 168, 1, 102))


def pcap_header() -> bytes:
    """Return the file header of a capture with nanosecond timestamps."""
    return struct.pack("<IHHiIII", _MAGIC_NS, 2, 4, 0, 0, _SNAP, _ETHERNET)


def pcap_record(time_ns: int, packet: bytes) -> bytes:
    """Return the record of a packet with its Unix time in nanoseconds."""
    return struct.pack("<IIII", *divmod(time_ns, 10**9), len(packet), len(packet)) + packet


def ethernet_udp(port: int, payload: bytes) -> bytes:
    """Return an Ethernet frame with a payload in a UDP packet over IPv4, from a port of a lidar to the same one."""
    udp = struct.pack(">HHHH", port, port, 8 + len(payload), 0) + payload
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, _DONT_FRAGMENT, 64, 17, 0) + _SOURCE + _TARGET
    head = head[:10] + _checksum(head).to_bytes(2, "big") + head[12:]
    return b"\x02\x00\x00\x00\x00\x01\x02\x00\x00\x00\x00\x02\x08\x00" + head + udp


def _checksum(header: bytes) -> int:
    total: int = sum(struct.unpack(f">{len(header) // 2}H", header))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF
