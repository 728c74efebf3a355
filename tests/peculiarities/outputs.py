"""Peculiarities of outputs: what a format cannot have, or must have."""

from tests.peculiarities.case import Case

CASES: list[Case] = []
