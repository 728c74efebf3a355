"""Packet captures (PCAP and PCAPNG): `source.CaptureSource`."""
