"""Peculiarities of packets of sensors, in captures and packet topics."""

from tests.peculiarities.case import Case

CASES: list[Case] = []
