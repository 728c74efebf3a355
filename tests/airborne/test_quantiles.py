"""Quantiles of groups of values."""

import numpy as np
import pytest

from seaclutter_cli.airborne.quantiles import quantile_of_each


@pytest.mark.parametrize("share", [0.25, 0.5])
def test_quantiles_of_groups_are_those_of_numpy(share):
    rng = np.random.default_rng(4)
    group, values = rng.integers(0, 30, 200), rng.normal(size=200)
    found = quantile_of_each(values, group, 40, share, least=4)
    for number, quantile in enumerate(found):
        own = values[group == number]
        expected = np.quantile(own, share, method="lower") if len(own) >= 4 else np.nan
        np.testing.assert_array_equal(quantile, expected)
    assert np.isnan(quantile_of_each(values[:0], group[:0], 3, share)).all()
