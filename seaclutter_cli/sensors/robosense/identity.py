"""Model of a RoboSense sensor, as far as its packets show it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.sensors.catalog import ADVICE, name_unsupported
from seaclutter_cli.sensors.robosense.models import (
    AIRY,
    AIRY_BY_MOUNTING,
    BPEARL_4,
    CLASSIC_ID,
    INFO_BYTES,
    MODELS,
    RUBY,
    RUBY_PLUS_80V,
    RobosenseModel,
)

_CLASSIC = ("RS-LiDAR-32", "RS-LiDAR-16", "RS-Bpearl")
_HELIOS = ("RS-Helios", "RS-Helios-16P")
_RUBIES = (
    ("RS-Ruby", "RS-Ruby-Plus"),
    ("RS-Ruby-80", "RS-Ruby-Plus-80"),
    ("RS-Ruby-48", "RS-Ruby-Plus-48"),
)
_BPEARL_4_TYPE, _80V_MODEL = (3, 4), 3
_AIRY_48, _AIRY_192, _AIRY_MOUNTING_AT = 1, 3, 289


def find_model(
    data: NDArray[np.uint8], info: NDArray[np.uint8], wanted: str | None, warnings: list[str], hint: str = ""
) -> RobosenseModel:
    """Return the model of a sensor that sent a data packet, shape (L,), and device information, shape (I, 1248).

    ``wanted`` is the model that the user names; there is a warning if the device information is of another one. The
    hint says what else the user has to pass; the error has it if the packets do not identify the model. `InputError` if
    they do not, or are of another or an unsupported model.
    """
    if name := name_unsupported(data):
        raise InputError(f"packets of a {name} are not supported; {ADVICE}")
    allowed = _possible(data)
    guessed = _guess(allowed, info)
    if wanted is None and guessed is None:
        names = f"{', '.join(allowed[:-1])} and {allowed[-1]}"
        raise InputError(f"RoboSense: {names} share a packet format: select one with --sensor{hint}")
    if wanted is None or wanted not in allowed:
        if wanted in MODELS or guessed is None:
            raise InputError(f"RoboSense: the packets are from {' or '.join(allowed)}, not from {wanted}")
        return _version(MODELS[guessed], data, info)
    if guessed not in (None, wanted):
        warnings.append(f"the device information is from {guessed}, but the packets are decoded as {wanted}")
    return _version(MODELS[wanted], data, info)


def _possible(data: NDArray[np.uint8]) -> Sequence[str]:
    """Return the models that share the format of a data packet."""
    if data[:4].tobytes() == CLASSIC_ID:
        return _CLASSIC
    if len(data) != INFO_BYTES:
        return _RUBIES[-1]
    if _is_airy(data):
        return ("RS-Airy-48" if data[32] == _AIRY_48 else "RS-Airy",)
    for names in _RUBIES:
        model = MODELS[names[0]]
        ids = data[RUBY.begin :: 4 + 3 * model.channels][: model.blocks]
        if (ids == RUBY.block_id[1] >> 8).all():
            return names
    return _HELIOS


def _guess(allowed: Sequence[str], info: NDArray[np.uint8]) -> str | None:
    """Return the model that device information shows; None if it does not."""
    if allowed == _CLASSIC:
        return next((name for packet in info if (name := _guess_classic(packet))), None)
    if allowed == _HELIOS:
        return _guess_helios(info[0]) if len(info) else "RS-Helios"
    return allowed[0] if len(allowed) == 1 else None


def _is_airy(data: NDArray[np.uint8]) -> bool:
    """Return whether a packet has eight blocks of 48 channels, of which each begins with FF EE."""
    return bool((data[AIRY.begin : AIRY.begin + 1184].reshape(8, 148)[:, :2] == (0xFF, 0xEE)).all())


def _version(model: RobosenseModel, data: NDArray[np.uint8], info: NDArray[np.uint8]) -> RobosenseModel:
    """Return the version of a model that sent a data packet and device information."""
    if model.name == "RS-Airy":
        if data[32] == _AIRY_192:
            raise InputError(f"packets of a RoboSense RS-Airy with 192 lasers are not supported; {ADVICE}")
        return AIRY_BY_MOUNTING.get(int(info[0, _AIRY_MOUNTING_AT]), model) if len(info) else model
    if model.name == BPEARL_4.name and tuple(data[31:33].tolist()) == _BPEARL_4_TYPE:
        return BPEARL_4
    return RUBY_PLUS_80V if model.name == RUBY_PLUS_80V.name and data[31] == _80V_MODEL else model


def _guess_classic(packet: NDArray[np.uint8]) -> str | None:
    """Return the classic model that sent a device information packet; None if its tables do not identify it."""
    of_32 = _is_used(packet[468:564])
    of_16 = _is_used(packet[1165:1213])
    if of_32 == of_16:
        return None
    if of_16:
        return "RS-LiDAR-16"
    # All lasers of an RS-Bpearl look up, half of those of an RS-LiDAR-32 look down.
    return "RS-LiDAR-32" if packet[468:564:3].any() else "RS-Bpearl"


def _guess_helios(packet: NDArray[np.uint8]) -> str:
    """Return the RS-Helios that sent a device information packet: one with 16 lasers lacks the angles of others."""
    return "RS-Helios-16P" if _is_used(packet[468:516]) and not _is_used(packet[516:564]) else "RS-Helios"


def _is_used(table: NDArray[np.uint8]) -> bool:
    return bool(((table != 0) & (table != 0xFF)).any())
