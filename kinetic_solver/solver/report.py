"""What a finished run says of itself."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Report:
    error: float
    """Estimated, over max f."""
    limited_by: str
    """What of the discretisation limits it, in words."""
    grids: str
    """All that the run used, with the times from which on."""
    missing: str
    """Where mean velocity and temperature are not given, in words; empty where they are everywhere."""

    def attributes(self) -> dict[str, str]:
        """For the dataset."""
        return {"limited_by": self.limited_by, "grids": self.grids, **({"missing": self.missing} if self.missing else {})}
