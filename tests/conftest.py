"""Settings for all tests."""

import os

from hypothesis import settings

# What has to pass unattended draws the same examples each time; at a desk, new ones.
settings.register_profile("unattended", derandomize=True)
if os.environ.get("CI"):
    settings.load_profile("unattended")
