"""What a variable is by its name and its unit: time, command, position, reference, frequency ... in many languages.

Names are taken apart into words (``PiezoSpannung_ist`` has three), accents are dropped, and words of four letters or
more are found at the beginning or the end of longer ones as well (``wegsensor``). A word is strong where it means only
one thing.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass

#: Words of each class; those of `command` are a reference where the unit is one of motion.
_VOCABULARY = """
time: t time times timestamp zeit messzeit zeitstempel zeitpunkt uhrzeit temps tiempo tempo tid tijd czas cas elapsed
    seconds secs sec sekunden millis micros 时间 時間 время
reference: r ref reference setpoint target desired wanted demand demanded soll sollwert sollposition sollweg consigne
    fuehrungsgroesse fuhrungsgrosse referenz riferimento referencia
command: command commanded cmd befehl kommando commande comando stellgroesse stellgrosse
drive: u ux uy uz input inp in vin uin dac ao drive driver excitation stimulus anregung eingang entree entrada ingresso
    ansteuerung stellsignal steuerspannung treiber source generator fgen
converter: dac ao
control: control controller
voltage: voltage volt volts v spannung tension tensione voltaje tensao piezo piezospannung actuator aktor aktuator
    actionneur stack amplifier verstaerker verstarker hv 電圧 电压 напряжение
monitor: monitor mon vmon readback
position: x y z theta position pos posn displacement displ disp weg auslenkung verschiebung verlagerung hub deplacement
    posizione spostamento posicion desplazamiento posicao deslocamento distance abstand distanz stroke extension
    elongation dehnung deflection deflexion travel motion stage tisch tip angle winkel tilt kippwinkel 位移 位置 変位
    положение перемещение
sensor: sensor output out response antwort ausgang sortie uscita salida saida reponse measured messwert gemessen mesure
    ist istwert istposition actual feedback reading interferometer laser lvdt encoder geber capacitive kapazitiv adc ai
    gauge probe capteur sensore
current: i current strom courant corriente corrente amps
force: force kraft kracht effort fuerza forza load
temperature: temperature temp temperatur temperatura
frequency: f freq frequency frequencies frequenz frequence frequencia frecuencia frequenza hz
angular: w omega kreisfrequenz pulsation
magnitude: magnitude mag gain amplitude betrag amplitudengang modulus module verstaerkung ampl
phase: phase phasengang phasenwinkel fase phi
re: re real realteil reel reelle
im: im imag imaginary imaginaer imaginar imaginarteil imaginaire
coherence: coherence coh koharenz kohaerenz coherencia cohe
transfer: h frf tf transfer response ubertragung uebertragungsfunktion
count: index idx sample samples nr no number point points count punkt row zeile n lfd datum date
"""


def _read_vocabulary(vocabulary: str) -> dict[str, tuple[str, ...]]:
    kinds = (line.partition(":") for line in vocabulary.strip().replace("\n    ", " ").splitlines())
    return {kind: tuple(words.split()) for kind, _, words in kinds}


VOCABULARY = _read_vocabulary(_VOCABULARY)
#: Words for the output of a system, which many call y.
OUTPUTS = ("output", "out", "ausgang", "sortie", "uscita", "salida", "saida")
#: Shorter words are no part of longer ones.
SHORTEST = 4
#: SI units of motion.
MOTION = ("m", "rad")
_AXIS = re.compile(r"(?:u|v|r|i|f|d|pos|cmd|ref|cap|sens?)?([xyz])")


@dataclass(frozen=True)
class Role:
    """What a variable seems to be.

    Parameters
    ----------
    column
        The column of a run without its axis: ``t``, ``u``, ``x``, ``r``, ``v``, ``i``, ``f``, ``T``; or of a frequency
        response: ``frequency``, ``magnitude``, ``phase``, ``re``, ``im``, ``coherence``; empty if nothing is known.
    strength
        3 where name or name and unit say so, 2 and 1 where they are less clear, 0 where only the unit does.
    axis
        ``x``, ``y``, ``z``, or a number, where the name has one.
    """

    column: str
    strength: int = 0
    axis: str = ""


def split_name(name: str) -> list[str]:
    """Return the words of a name, in small letters without accents; numbers by themselves.

    >>> split_name("PiezoSpannung_ist2"), split_name("Déplacement-X"), split_name("bench/AO0")
    (['piezo', 'spannung', 'ist', '2'], ['deplacement', 'x'], ['bench', 'ao', '0'])
    """
    plain = "".join(
        sign for sign in unicodedata.normalize("NFKD", name.replace("ß", "ss")) if not unicodedata.combining(sign)
    )
    parted = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", plain)
    return [word.lower() for word in re.findall(r"[^\W\d_]+|\d+", parted)]


def classes(name: str) -> set[str]:
    """Return the classes of `VOCABULARY` that the words of a name belong to."""
    remark = split_name(name)
    return {kind for kind, known in VOCABULARY.items() if any(_is(word, known) for word in remark)}


def _is(word: str, known: Sequence[str]) -> bool:
    if word in known:
        return True
    long = [each for each in known if len(each) >= SHORTEST]
    return len(word) > SHORTEST and any(word.startswith(each) or word.endswith(each) for each in long)


def axis_of(name: str) -> str:
    """Return the axis or the number that a name has: ``x`` of ``Sensor X`` or ``ux``, ``2`` of ``CH2``."""
    remark = split_name(name)
    for word in remark:
        if match := _AXIS.fullmatch(word):
            return match[1]
    return next((word for word in reversed(remark) if word.isdigit() and len(word) == 1), "")


def is_output(name: str) -> bool:
    """Tell whether a name is that of the output y of a system, and says no more.

    >>> is_output("y"), is_output("Saida_y"), is_output("Sensor Y")
    (True, True, False)
    """
    return set(split_name(name)) <= {"y", *OUTPUTS}


def role_of(name: str, si: str) -> Role:
    """Return what a variable is by its name and the SI unit of its unit; that is empty where no unit is known."""
    remark, axis = classes(name), axis_of(name)
    if name.strip().lower().replace("-", "_").replace(" ", "_") in ("x_value", "x_axis"):
        return Role("t", 2)
    if not si and "position" in remark and remark & {"command", "reference"}:
        return Role("u", 1, axis)  # a target position: next to what a controller puts out, it is no command
    for kind, column, allowed, strength in _RULES:
        if remark & kind and si in allowed:
            return Role(column, strength, axis)
    column = {"s": "t", "m": "x", "rad": "x", "V": "u", "A": "i", "N": "f", "K": "T", "Hz": "frequency"}.get(si, "")
    return Role("" if "count" in remark else column, 0, axis)


#: The first one that fits: words of a class, the column, which SI units, and how clear that is.
_RULES: tuple[tuple[set[str], str, tuple[str, ...], int], ...] = (
    ({"time"}, "t", ("s",), 3),
    ({"coherence"}, "coherence", ("1", ""), 3),
    ({"frequency", "angular"}, "frequency", ("Hz",), 3),
    ({"phase"}, "phase", ("rad", ""), 3),
    ({"magnitude", "re", "im"}, "", ("m/V", "rad/V"), 3),  # which of them, `line_of` says
    ({"temperature"}, "T", ("K", ""), 3),
    ({"current"}, "i", ("A",), 3),
    ({"force"}, "f", ("N",), 3),
    ({"command", "reference", "drive"}, "r", MOTION, 3),
    ({"command"}, "u", ("V", ""), 3),
    ({"reference"}, "u", ("V", ""), 2),  # a target position, too
    ({"position"}, "x", (*MOTION, "V", ""), 3),
    ({"control"}, "u", ("V", ""), 2),  # "control effort": what a controller puts out enters the stage
    ({"monitor"}, "v", ("V", ""), 2),
    ({"converter"}, "u", ("V", ""), 2),  # "DAC out": what leaves a converter enters the stage
    ({"sensor"}, "x", MOTION, 2),
    ({"sensor"}, "x", ("V", ""), 1),  # a length is clearer
    ({"drive"}, "u", ("V", ""), 2),
    ({"voltage"}, "u", ("V", ""), 1),
    ({"command", "reference", "drive"}, "u", ("1",), 1),  # counts of a converter
    ({"position", "sensor"}, "x", ("1",), 1),
    ({"time"}, "t", ("",), 2),
    ({"current"}, "i", ("",), 2),
    ({"force"}, "f", ("",), 2),
    ({"frequency"}, "frequency", ("",), 2),
)


def line_of(name: str, si: str) -> str:
    """Return which column of a frequency response a variable is: f, magnitude, phase, re, im, coherence; or nothing.

    A magnitude may have any unit but those that tell what else it is: analysers state responses per newton or ampere.
    """
    remark = classes(name)
    allowed = {
        "frequency": ("Hz", ""), "angular": ("Hz", ""), "coherence": ("1", ""), "phase": ("rad", ""),
    }  # fmt: skip
    found = next((kind for kind, units in allowed.items() if kind in remark and si in units), "")
    if not found and si not in ("s", "Hz", "K"):
        found = next((kind for kind in ("re", "im", "magnitude") if kind in remark), "")
    return "f" if found in ("frequency", "angular") else found
