"""Attenuation by air."""


def extinction(visibility_km: float) -> float:
    r"""Return the extinction coefficient :math:`\alpha` of Eq. 2 of [Li2023] in 1/m, by Koschmieder's law.

    Parameters
    ----------
    visibility_km : float
        Meteorological visibility.

    Examples
    --------
    >>> extinction(3.912)
    0.001
    """
    return 3.912 / (1000 * visibility_km)
