"""One function of the Python face in a process of its own, which may be ended at any moment.

Reads one JSON object from stdin: ``verb``, ``arguments``, ``options``, ``folder``. Writes JSON lines to stdout: what is
going on, and at last what was found or why not. The report is written into the folder.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Mapping
from typing import Any

import flexdesign as fd

#: What may be asked for; each takes `progress`.
VERBS = ("validate", "optimize", "sweep", "plan", "compare", "diagnose", "add_effect")


def main() -> None:
    """Do what stdin asks for."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    channel, sys.stdout = sys.stdout, sys.stderr  # what libraries print is no answer

    def tell(**fact: object) -> None:
        channel.write(json.dumps(fact) + "\n")
        channel.flush()

    try:
        tell(done=_answer(json.loads(sys.stdin.read()), lambda text: tell(progress=text)))
    except fd.InputError as error:
        tell(error=str(error))


def _answer(asked: Mapping[str, Any], progress: Any) -> dict[str, object]:
    if asked["verb"] not in VERBS:
        raise fd.InputError("workbench", "verb", asked["verb"], f"is none of {', '.join(VERBS)}")
    found = getattr(fd, asked["verb"])(*asked["arguments"], **asked["options"], progress=progress)
    progress("writing the report")
    written = found.report(asked["folder"])
    return {
        "title": found.document.title,
        "summary": [*found.document.warnings, *found.document.summary],
        "columns": list(found.table.columns),
        "rows": [list(row) for row in found.table.rows],
        "files": [path.name for path in written if path.parent.samefile(asked["folder"])],
    }


def _end_with(parent: int) -> None:
    """End as soon as the server is gone, even one that was killed."""
    while os.getppid() == parent:
        threading.Event().wait(1.0)
    os._exit(1)


if __name__ == "__main__":
    main()
