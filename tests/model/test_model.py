"""The nouns: what they say of themselves, and what they refuse."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

from flexdesign.core.model import Adjust, Block, Effect, Linkage, Member, Parameter, Quantity, Socket

# --- quantities ---------------------------------------------------------------------------------------------------

K_OUT = Quantity("K_out", 209.1e3, "N/m", "N/mm", "input held", "FEM", half_width=1.25e3)


def test_key_joins_name_and_boundary() -> None:
    assert K_OUT.key == "K_out_input_held"
    assert Quantity("f", 1.0, "Hz", "Hz").key == "f"
    assert Quantity("F", 1.0, "N", "N", "full stroke, output free").key == "F_full_stroke_output_free"


@pytest.mark.parametrize(
    ("quantity", "text"),
    [
        (K_OUT, "209.1 ± 1.2 N/mm"),
        (Quantity("k", 32584.2, "N m/rad", "N m/rad", half_width=262.0), "32580 ± 260 N m/rad"),
        (Quantity("lambda", -12.0305, "1", ""), "-12.03"),
        (Quantity("s", 3.8e-5, "m", "um"), "38.00 um"),
        (Quantity("tilt", 2e-6, "rad/m", "urad/um"), "2.000e-06 urad/um"),
        (Quantity("k", 1.41464e8, "N m/rad", "N m/rad", half_width=1.093e6), "1.415e+08 ± 1.1e+06 N m/rad"),
        (Quantity("k", 5.2406e-9, "N m/rad", "N m/rad", half_width=3.9e-11), "5.241e-09 ± 3.9e-11 N m/rad"),
    ],
)
def test_shown_in_the_display_unit(quantity: Quantity, text: str) -> None:
    """1.25 rounds to even, as floats do."""
    assert quantity.formatted() == text


def test_digits_can_be_chosen() -> None:
    assert dataclasses.replace(K_OUT, half_width=None).formatted(6) == "209.100 N/mm"


def test_text_names_the_boundary() -> None:
    assert str(K_OUT) == "K_out (input held) = 209.1 ± 1.2 N/mm"
    assert str(Quantity("lambda", 4.05, "1", "")) == "lambda = 4.050"


def test_json_is_in_the_display_unit_and_survives() -> None:
    table = K_OUT.to_json()
    assert json.loads(json.dumps(table)) == table
    assert table["unit"] == "N/mm" and table["name"] == "K_out" and table["source"] == "FEM"
    assert table["value"] == pytest.approx(209.1, rel=1e-15) and table["half_width"] == pytest.approx(1.25, rel=1e-15)
    ratio = Quantity("lambda", 4.0, "1", "").to_json()
    assert ratio["unit"] == "1" and ratio["half_width"] is None and ratio["value"] == 4.0


def test_a_display_unit_of_another_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="'mm'"):
        dataclasses.replace(K_OUT, unit="mm").formatted()


# --- parameters ---------------------------------------------------------------------------------------------------


def test_plausible_range_includes_its_bounds() -> None:
    thickness = Parameter("t", "m", "mm", "thickness", plausible=(1e-4, 1e-3))
    found = [thickness.is_plausible(v) for v in (0.99e-4, 1e-4, 5e-4, 1e-3, 1.01e-3, math.nan, math.inf)]
    assert found == [False, True, True, True, False, False, False]
    assert Parameter("t", "m", "mm", "thickness").is_plausible(-1e300)


# --- members and linkages -----------------------------------------------------------------------------------------

LEAF = Member("hinge_1", "hinge", ("a", "b"), (1e-3, 2e-3, 0.0), (4e-3, 6e-3, 0.0), 0.5e-3, 12e-3)


def test_member_s_geometry() -> None:
    """A 3-4-5 triangle."""
    assert LEAF.length == pytest.approx(5e-3, rel=1e-15)
    assert LEAF.centre == pytest.approx((2.5e-3, 4e-3, 0.0), rel=1e-15)
    assert LEAF.axis == pytest.approx((0.6, 0.8, 0.0), rel=1e-15)
    assert LEAF.area == pytest.approx(6e-6, rel=1e-15)
    assert LEAF.second_moment == pytest.approx(12e-3 * 0.5e-3**3 / 12, rel=1e-15)


def test_leaf_is_equally_thick_everywhere() -> None:
    assert {LEAF.thickness_at(s) for s in np.linspace(-2.5e-3, 2.5e-3, 11)} == {0.5e-3}


def test_fillets_thicken_a_leaf_at_its_ends() -> None:
    """Twice the rise of a quarter circle: r - sqrt(r^2 - x^2), x from the fillet's beginning."""
    filleted = dataclasses.replace(LEAF, root_radius=0.4e-3)
    places = {0.0: 0.0, 2.1e-3: 0.0, 2.1e-3 + 0.24e-3: 0.08e-3, 2.1e-3 + 0.32e-3: 0.16e-3, 2.5e-3: 0.4e-3}  # 3-4-5
    for s, rise in places.items():
        for side in (s, -s):
            assert filleted.thickness_at(side) == pytest.approx(0.5e-3 + 2 * rise, rel=1e-6)


def test_circular_notch_thickens_away_from_its_neck() -> None:
    """The circle's points are one radius from its centre, which stands off the axis by R + t/2."""
    notch = dataclasses.replace(LEAF, curvature_radius=2.5e-3)
    for s in np.linspace(-2.5e-3, 2.5e-3, 21):
        height = notch.thickness_at(s) / 2
        assert math.hypot(s, notch.curvature_radius + 0.25e-3 - height) == pytest.approx(2.5e-3, rel=1e-12)
    assert notch.thickness_at(0.0) == 0.5e-3


def test_linkage_finds_members_by_kind() -> None:
    arm = dataclasses.replace(LEAF, name="arm_1", kind="arm")
    linkage = Linkage({"a": (0.0, 0.0, 0.0), "b": (1.0, 0.0, 0.0)}, (LEAF, arm), {"output": "b"})
    assert linkage.of_kind("hinge") == (LEAF,)
    assert linkage.of_kind("arm") == (arm,)
    assert linkage.of_kind("guide") == ()


def test_linkage_refuses_a_member_to_nowhere() -> None:
    with pytest.raises(ValueError, match=r"^member hinge_1 joins b, which is not among the nodes$"):
        Linkage({"a": (0.0, 0.0, 0.0)}, (LEAF,))


def test_linkage_refuses_a_port_on_no_node() -> None:
    with pytest.raises(ValueError, match="output"):
        Linkage({"a": (0.0, 0.0, 0.0), "b": (1.0, 0.0, 0.0)}, (LEAF,), {"output": "c"})


# --- effects ------------------------------------------------------------------------------------------------------


def test_sockets_follow_the_signal() -> None:
    expected = ["COMMAND", "DRIVER", "HYSTERESIS", "ACTUATOR", "FORCE", "MECHANICS", "SENSOR"]
    assert [socket.name for socket in Socket] == expected
    assert [socket.value for socket in sorted(Socket, key=lambda socket: socket.value)] == list(range(7))


def effect(*parameters: Parameter) -> Effect:
    return Effect(
        "e", "physics", "where", "reveal", "remedy", "reference", parameters, (Adjust(lambda base, _: dict(base)),)
    )


def test_effect_is_null_where_all_strengths_stand_at_their_nulls() -> None:
    strength = Parameter("gain", "1", "", "strength", null=0.0)
    limit = Parameter("limit", "V", "V", "limit", null=math.inf)
    constant = Parameter("time", "s", "s", "time constant")
    both = effect(strength, limit, constant)
    assert not both.is_null({"gain": 0.0, "limit": 5.0, "time": 1.0})
    assert not both.is_null({"gain": 0.1, "limit": math.inf, "time": 1.0})
    assert both.is_null({"gain": 0.0, "limit": math.inf, "time": 1.0})
    assert not both.is_null({"gain": 0.1, "limit": 5.0, "time": 0.0})
    assert not both.is_null({"gain": -1e-300, "limit": 5.0, "time": 0.0})
    assert not effect(constant).is_null({"time": 0.0})


def test_blocks_add_unless_told_otherwise() -> None:
    assert Block(Socket.SENSOR).mode == "add"
    assert Block(Socket.SENSOR).states == ()
