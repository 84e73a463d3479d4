"""The lever of `notched_lever.py` whose notch is declared as two fillets that meet at the neck."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from flexdesign.design import part

Circular = part.load("notched_lever", Path(__file__).parent)


class FilletedLever(Circular):  # type: ignore[misc, valid-type]
    """A lever on one notch, declared by `Member.root_radius`."""

    by_fillets: ClassVar[bool] = True
