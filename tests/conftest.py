"""Settings for all tests."""

import signal

from hypothesis import settings

# A test passes or fails for its code, not for its luck or a busy machine: the same examples each time, and no time
# limit for one. To look for new examples, run pytest --hypothesis-profile=search.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("search", derandomize=False, deadline=None)
settings.load_profile("same")

# A shell's background jobs ignore this signal, and so would the programs that tests start in order to interrupt them.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
