"""The library of materials as a mapping."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from flexdesign.core.errors import suggest
from flexdesign.design.materials import Material, library


class Materials(Mapping[str, Material]):
    """The materials that come with flexdesign, by name; read when first used."""

    def __getitem__(self, name: str) -> Material:
        """Return a material; the message of KeyError suggests one."""
        known = library()
        if name not in known:
            raise KeyError(f"{name}{suggest(name, list(known))}")
        return known[name]

    def __iter__(self) -> Iterator[str]:
        """Go through the names."""
        return iter(library())

    def __len__(self) -> int:
        """Return how many there are."""
        return len(library())


materials = Materials()
