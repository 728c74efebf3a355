"""Peculiarities of recordings and their records: bags, MCAP files, folders, split files."""

from tests.peculiarities.case import Case

CASES: list[Case] = []
