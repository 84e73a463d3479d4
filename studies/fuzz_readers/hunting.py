"""Damaged files one by one, and how reading each of them ended."""

from __future__ import annotations

import contextlib
import faulthandler
import io
import logging
import re
import shutil
import signal
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from flexdesign.core.errors import InputError
from studies.fuzz_readers.mutations import damage
from studies.fuzz_readers.readers import READERS

#: No reading takes longer, in seconds of the processor, which a busy machine does not lengthen; nor this multiple of it
#: by the clock; a library that does not come back ends the process after twice that.
LONGEST, GIVEN_UP = 10.0, 6
#: No message has more letters, the folder that the file is in not counted.
LETTERS = 400
#: Words of libraries and of Python that mean nothing to an engineer.
JARGON = re.compile(
    r"Traceback|pydantic|Input should|NoneType|\bdict\b|dtype|ndarray|Errno|\b[A-Z]\w+(Error|Exception|Warning)\b"
    r"|<class|subscriptable|unpack|codec|invalid literal|\bint\(|\bfloat\(|\bstr\b|__\w+__|set_int_max|iterable"
    r"|object at|argument|operand|broadcast|callable|recursion|regex|NumPy|numpy|pyarrow|h5py|errno|pickle|thrift"
)


class Hang(BaseException):
    """Reading took too long."""


@dataclass(frozen=True)
class Finding:
    """Something that must not happen.

    Parameters
    ----------
    reader, number
        Which input it was.
    cause
        What happened, in words by which the same cause is recognised.
    details
        All that is known of it.
    """

    reader: str
    number: int
    cause: str
    details: str


@dataclass
class Hunt:
    """What was read, and what was found.

    Parameters
    ----------
    seed
        From it every input follows.
    folder
        Where inputs are written, and those that find something are kept.
    report
        Takes each cause when it is first found.
    """

    seed: int
    folder: Path
    report: Callable[[Finding, Path], None] = lambda finding, kept: None
    inputs: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    causes: Counter[tuple[str, str]] = field(default_factory=Counter)

    def run(self, name: str, first: int, count: int) -> None:
        """Read some inputs of one reader."""
        contents = {file: make() for file, make in READERS[name].files.items()}
        for number in range(first, first + count):
            self._read(name, number, contents)

    def _read(self, name: str, number: int, contents: dict[str, bytes]) -> None:
        """Damage one of the files, read it, and keep it if that finds something; number 0 is not damaged."""
        reader, chance = READERS[name], Random(f"{self.seed} {name} {number}")
        files = dict(contents)
        if number:
            file = chance.choice(sorted(reader.damaged))
            files[file] = damage(files[file], reader.damaged[file], chance)
        # It stays there if the process ends.
        now = self.folder / "now" / name
        shutil.rmtree(now, ignore_errors=True)
        now.mkdir(parents=True)
        for file, data in files.items():
            (now / file).write_bytes(data)
        self.inputs[name] += 1
        finding = self._check_reading(name, number, now, must_be_read=number == 0)
        if finding is None:
            return
        self.causes[name, finding.cause] += 1
        if self.causes[name, finding.cause] == 1:
            kept = self.folder / "kept" / name / str(number)
            shutil.rmtree(kept, ignore_errors=True)
            shutil.copytree(now, kept)
            (kept / "finding.txt").write_text(
                f"{finding.cause}\n\n{finding.details}\n", encoding="utf-8", errors="replace"
            )
            self.report(finding, kept)

    def _check_reading(self, name: str, number: int, now: Path, *, must_be_read: bool) -> Finding | None:
        """Read a folder, and return what was wrong with how that ended."""

        def finding(cause: str, details: str) -> Finding:
            return Finding(name, number, cause, details)

        said, warned = io.StringIO(), list[warnings.WarningMessage]()
        began = time.process_time()
        try:
            with _time_limit(LONGEST), _capture_output(said, warned):
                READERS[name].read(now)
        except InputError as error:
            self.refused[name] += 1
            if must_be_read:
                return finding("the undamaged file is refused", str(error))
            if wrong := message_faults(error):
                return finding(f"message {wrong[0]} ({_place_of(error)})", "\n".join([str(error), *wrong]))
            left = [str(path.relative_to(now)) for path in (now / "out").rglob("*") if path.is_file()]
            if left:
                return finding("refused, but files are left", f"{error}\n{left}")
        except Hang as error:
            return finding(f"hang ({_place_of(error)})", traceback.format_exc())
        except Exception as error:
            return finding(f"{type(error).__name__} ({_place_of(error)})", traceback.format_exc())
        if time.process_time() - began > LONGEST:
            return finding("hang in a library", f"{time.process_time() - began:.0f} s")
        if warned:
            first = warned[0]
            place = f"{Path(first.filename).name}:{first.lineno}"
            return finding(f"warning ({place})", f"{first.filename}:{first.lineno} {first.message}")
        if said.getvalue():
            return finding("writes on the terminal", said.getvalue())
        return None


def message_faults(error: InputError) -> list[str]:
    """Return what is wrong with a message."""
    message = str(error).replace(error.file, Path(error.file).name)
    remedy, wrong = error.remedy.strip(), list[str]()
    if len(message) > LETTERS:
        wrong.append(f"has {len(message)} letters")
    if not message.isprintable():
        wrong.append("has signs that cannot be printed")
    if jargon := JARGON.search(message):
        wrong.append(f"has jargon: {jargon[0]}")
    if not error.file.strip() or not remedy or remedy.isnumeric():
        wrong.append("names no file or no remedy")
    return wrong


def _place_of(error: BaseException) -> str:
    """Return where in the program something was raised, or the last place of the program on the way to it."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "flexdesign" in Path(frame.filename).parts]
    last = (ours or list(frames))[-1]
    return f"{Path(last.filename).name}:{last.lineno} {last.name}"


@contextlib.contextmanager
def _capture_output(said: io.StringIO, warned: list[warnings.WarningMessage]) -> Iterator[None]:
    """Gather what is printed, logged and warned of."""
    handler = logging.StreamHandler(said)
    logging.getLogger().addHandler(handler)
    try:
        with (
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
            warnings.catch_warnings(record=True) as found,
        ):
            warnings.simplefilter("always")
            yield
        warned += found
    finally:
        logging.getLogger().removeHandler(handler)


@contextlib.contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    """Raise Hang after `seconds`; end the process where that does not help, and say where it is."""

    def stop(*_: object) -> None:
        raise Hang

    clocks = ((signal.SIGPROF, signal.ITIMER_PROF, seconds), (signal.SIGALRM, signal.ITIMER_REAL, GIVEN_UP * seconds))
    before = [signal.signal(number, stop) for number, _, _ in clocks]
    for _, clock, longest in clocks:
        signal.setitimer(clock, longest)
    with contextlib.suppress(io.UnsupportedOperation):  # a terminal that is no file
        faulthandler.dump_traceback_later(2 * GIVEN_UP * seconds, exit=True)
    try:
        yield
    finally:
        for _, clock, _ in clocks:
            signal.setitimer(clock, 0)
        faulthandler.cancel_dump_traceback_later()
        for (number, _, _), old in zip(clocks, before, strict=True):
            signal.signal(number, old)
