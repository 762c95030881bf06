"""Skip condition of viewer tests without a Vulkan driver; where no test may be skipped, a missing driver is an error."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

_FOLDERS = (Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d"))
_DRIVERS = [file for folder in _FOLDERS if folder.is_dir() for file in folder.glob("*.json")]

needs_viewer = pytest.mark.skipif(
    not _DRIVERS and os.environ.get("CI") != "true",
    reason="no Vulkan driver for the viewer (mesa-vulkan-drivers has one)",
)
