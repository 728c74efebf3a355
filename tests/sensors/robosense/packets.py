"""RoboSense packets with settings and layouts that the simulation does not need."""

from dataclasses import replace

import numpy as np

from seaclutter_cli.sensors.robosense import packets
from seaclutter_cli.sensors.robosense.models import INFO_BYTES


def write_info(model, angles, *, fov=(0, 36000), return_mode=1, is_old=False, is_reversed=False):
    """Return device information; without angles, its tables are not programmed."""
    packet = np.zeros(INFO_BYTES, np.uint8) if angles is None else packets.write_info(model, angles)
    packet[32:36] = np.array(fov, ">u2").view(np.uint8)
    packet[300], packet[337] = return_mode, is_reversed
    if is_old:
        packet[40:50], packet[45:48], packet[291] = 0, (8, 2, 8), 0xA1
    if angles is None:
        packet[:8], packet[468:660], packet[1165:1213] = np.frombuffer(packets.INFO_ID, np.uint8), 0xFF, 0xFF
    return packet


def write_data(model, columns):
    """Return data packets; each block of an RS-Airy has a second header between the halves of its channels."""
    if not model.format.has_halves:
        return packets.write_data(model, columns)
    payloads = packets.write_data(replace(model, format=replace(model.format, has_halves=False)), columns)
    begin, size, half = model.format.begin, 4 + 3 * model.channels, 4 + 3 * model.channels // 2
    blocks = payloads[:, begin : begin + size * model.blocks].reshape(len(payloads), model.blocks, size)
    pieces = np.concatenate([blocks[:, :, :half], blocks[:, :, :4], blocks[:, :, half:]], axis=2)
    payloads[:, begin : begin + (size + 4) * model.blocks] = pieces.reshape(len(payloads), -1)
    return payloads
