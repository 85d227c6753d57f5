"""What hatchling asks about a wheel: whether it is one of this Python and system, because it ships kernels."""

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class WheelHook(BuildHookInterface):
    """Gives wheels with compiled kernels the tag of what they were compiled for."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Inform the builder before it begins."""
        if version == "standard" and Path(self.root, "bspline_mdao", "_kernels").is_dir():
            build_data.update(pure_python=False, infer_tag=True)
