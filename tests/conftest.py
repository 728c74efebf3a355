"""Settings for all tests."""

from hypothesis import settings

# A test passes or fails for its code, not for its luck: the same examples each time. To look for new ones, run
# pytest --hypothesis-profile=search.
settings.register_profile("same", derandomize=True)
settings.register_profile("search", derandomize=False)
settings.load_profile("same")
