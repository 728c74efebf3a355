"""Settings for all tests."""

from hypothesis import settings

# A test passes or fails for its code, not for its luck or a busy machine: the same examples each time, and no time
# limit for one. To look for new examples, run pytest --hypothesis-profile=search.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("search", derandomize=False, deadline=None)
settings.load_profile("same")
