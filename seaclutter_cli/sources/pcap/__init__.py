"""Packet captures (PCAP and PCAPNG): `source.CaptureSource`, and the first bytes of their files."""

from pathlib import Path

PCAP_MAGICS = {
    bytes.fromhex("a1b2c3d4"): (">", 1000),
    bytes.fromhex("d4c3b2a1"): ("<", 1000),
    bytes.fromhex("a1b23c4d"): (">", 1),
    bytes.fromhex("4d3cb2a1"): ("<", 1),
}
"""Byte order and nanoseconds per tick of classic captures, by their first bytes."""
PCAPNG_MAGIC = bytes.fromhex("0a0d0d0a")
CAPTURE_MAGICS = (*PCAP_MAGICS, PCAPNG_MAGIC)


def metadata_of(capture: Path, suffix: str) -> list[Path]:
    """Return the files beside a capture where one name starts with the other: the one with the same name first."""
    same = capture.with_suffix(suffix)
    found = [same] if same.is_file() else []
    try:
        others = [file for file in capture.parent.iterdir() if file.suffix.lower() == suffix and file.is_file()]
    except OSError:
        return found
    alike = [file for file in others if capture.stem.startswith(file.stem) or file.stem.startswith(capture.stem)]
    return found + [file for file in alike if file != same]
