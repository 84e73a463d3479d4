"""What README.md claims is what the kept example report holds."""

from __future__ import annotations

import json
import re
from pathlib import Path

from flexdesign.model import Quantity

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
EXAMPLE = json.loads((ROOT / "reports" / "examples" / "bridge_amplifier" / "result.json").read_text())


def test_table_is_the_example_report() -> None:
    rows = [line for line in README.splitlines() if re.match(r"(K_in|K_out|λ) ", line)]
    compared = [quantity for quantity in EXAMPLE["quantities"] if quantity.get("analytic")]
    assert len(rows) == len(compared) == 5
    for row, found in zip(rows, compared, strict=True):
        fem = Quantity(found["name"], found["value"], "1", "", sigma=found["sigma"]).shown()
        assert fem in row
        assert found["boundary"] in row
        for analytic in found["analytic"].values():
            assert Quantity("", analytic["value"], "1", "").shown() in row
            assert f"{100 * analytic['error']:+.1f}" in row


def test_linked_files_exist() -> None:
    links = re.findall(r"\]\((?!http)([^)#]+)\)", README)
    assert len(links) >= 6
    for link in links:
        assert (ROOT / link).exists(), link


def test_make_targets_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"`?make ([a-z]+)", README):
        assert re.search(rf"^{target}:", makefile, re.M), target
