"""Packet captures (PCAP and PCAPNG): `source.CaptureSource`, and the first bytes of their files."""

PCAP_MAGICS = {
    bytes.fromhex("a1b2c3d4"): (">", 1000),
    bytes.fromhex("d4c3b2a1"): ("<", 1000),
    bytes.fromhex("a1b23c4d"): (">", 1),
    bytes.fromhex("4d3cb2a1"): ("<", 1),
}
"""Byte order and nanoseconds per tick of classic captures, by their first bytes."""
PCAPNG_MAGIC = bytes.fromhex("0a0d0d0a")
CAPTURE_MAGICS = (*PCAP_MAGICS, PCAPNG_MAGIC)
