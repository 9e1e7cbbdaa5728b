"""The magnetic field of the world, against the formulas for dipoles and balls of iron."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tests.world.conftest import WorldMaker
from twin.errors import BadInputError
from twin.signals import MagneticField, MagneticNeed, Mount
from twin.world.magnetics import MagnetConfig, Magnetics, MagneticsConfig
from twin.world.terrain import FlatTerrain, Terrain, build_terrain

GROUND: Terrain = build_terrain(FlatTerrain(kind="flat", cell_m=1.0), seed=1, extent=(-10.0, -10.0, 10.0, 10.0))


def magnetics(**keys: Any) -> Magnetics:
    return Magnetics(MagneticsConfig.model_validate(keys), GROUND)


def disturbance(at: tuple[float, float, float], t_s: float = 0.0, **keys: Any) -> np.ndarray:
    place = np.array(at)
    return magnetics(**keys).field_ut(place, t_s) - magnetics().field_ut(place, t_s)


def magnet(**keys: Any) -> dict[str, Any]:
    return {"east_m": 1.0, "north_m": 2.0, "height_m": 0.5, "moment_a_m2": [0.0, 0.0, 2.0], **keys}


def test_a_dipoles_field_is_the_formulas() -> None:
    # mu0 / (4 pi) = 0.1 uT m^3 / (A m^2). 2 A m^2 upwards: 0.2 m above it 2 m / r^3: 0.1 x 4 / 0.008 = 50 uT up; 0.2 m
    # beside it half of that, downwards.
    np.testing.assert_allclose(disturbance((1.0, 2.0, 0.7), magnets=[magnet()]), [0.0, 0.0, 50.0], atol=1e-9)
    np.testing.assert_allclose(disturbance((1.2, 2.0, 0.5), magnets=[magnet()]), [0.0, 0.0, -25.0], atol=1e-9)
    # At 45 degrees up and east: n = (1, 0, 1) / sqrt(2), m.n = sqrt(2): 3 x (1, 0, 1) - (0, 0, 2) = (3, 0, 1).
    r = 0.3
    at = (1.0 + r / math.sqrt(2.0), 2.0, 0.5 + r / math.sqrt(2.0))
    expected = 0.1 / r**3 * np.array([3.0, 0.0, 1.0])
    np.testing.assert_allclose(disturbance(at, magnets=[magnet()]), expected, rtol=1e-9, atol=1e-12)


def test_fields_of_several_pieces_add_up_and_fall_with_the_cube_of_distance() -> None:
    one, two = magnet(), magnet(east_m=-2.0, moment_a_m2=[1.0, -1.0, 0.0])
    at = (0.0, 1.0, 0.3)
    both = disturbance(at, magnets=[one, two])
    np.testing.assert_allclose(both, disturbance(at, magnets=[one]) + disturbance(at, magnets=[two]), atol=1e-12)
    near, far = disturbance((1.5, 2.0, 0.5), magnets=[one]), disturbance((2.0, 2.0, 0.5), magnets=[one])
    np.testing.assert_allclose(near, 8.0 * far, rtol=1e-9, atol=1e-12)


def test_a_ball_of_iron_draws_the_field_in() -> None:
    # At the pole of a ball of high permeability the field is three times the undisturbed one, at its waist nothing is
    # left of the part along the axis; at twice the radius the addition is 2/8 and -1/8.
    straight_down = {"inclination_deg": 90.0, "strength_ut": 40.0}
    iron = [{"east_m": 0.0, "north_m": 0.0, "height_m": 0.0, "radius_m": 0.1, "permeability": 1e9}]
    field = magnetics(**straight_down, iron=iron)
    for place, factor in (((0, 0, 0.1), 3.0), ((0.1, 0, 0), 0.0), ((0, 0, -0.2), 1.25), ((0, 0.2, 0), 0.875)):
        np.testing.assert_allclose(field.field_ut(np.array(place), 0.0), [0.0, 0.0, -40.0 * factor], atol=1e-6)


def test_nearer_than_its_own_size_a_piece_is_felt_as_at_its_surface() -> None:
    keys = {"magnets": [magnet(radius_m=0.05)]}
    surface, inside = disturbance((1.0, 2.0, 0.55), **keys), disturbance((1.0, 2.0, 0.51), **keys)
    np.testing.assert_allclose(inside, surface, rtol=1e-9)
    assert np.isfinite(disturbance((1.0, 2.0, 0.5), **keys)).all()


def test_a_magnet_comes_and_goes_as_a_raised_cosine() -> None:
    config = MagnetConfig.model_validate(magnet(from_s=5.0, to_s=12.0, ramp_s=2.0))
    shares = {4.9: 0.0, 5.0: 0.0, 6.0: 0.5, 5.5: 0.5 - 0.5 * math.cos(math.pi / 4.0), 7.0: 1.0, 10.0: 1.0, 11.0: 0.5}
    for t_s, share in {**shares, 12.0: 0.0, 30.0: 0.0}.items():
        assert config.share(t_s) == pytest.approx(share, abs=1e-12), t_s
    keys = {"magnets": [magnet(from_s=5.0, to_s=12.0, ramp_s=2.0)]}
    np.testing.assert_allclose(disturbance((1.2, 2.0, 0.5), 6.0, **keys), [0.0, 0.0, -12.5], atol=1e-9)


def test_a_magnet_may_be_swung_past_again_and_again() -> None:
    # Two seconds from one coming to the next, one up and one down: (1 - cos(pi t)) / 2.
    config = MagnetConfig.model_validate(magnet(from_s=1.0, to_s=3.0, ramp_s=1.0, every_s=2.0))
    for t_s in (0.0, 1.3, 2.0, 2.9, 3.4, 17.7):
        expected = 0.0 if t_s < 1.0 else 0.5 - 0.5 * math.cos(math.pi * (t_s - 1.0))
        assert config.share(t_s) == pytest.approx(expected, abs=1e-9)
    assert MagnetConfig.model_validate(magnet()).share(1e4) == 1.0


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"from_s": 5.0, "to_s": 6.0, "ramp_s": 1.0}, "later than from_s by two ramps"),
        ({"every_s": 2.0}, "every_s needs to_s"),
        ({"to_s": 3.0, "every_s": 2.0}, "shorter than it stays"),
    ],
)
def test_times_that_do_not_fit_are_refused(keys: dict[str, float], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        MagnetConfig.model_validate(magnet(**keys))


def test_a_magnet_off_the_terrain_is_refused() -> None:
    with pytest.raises(BadInputError, match=r"magnetics.magnets.1: .*off the terrain"):
        magnetics(magnets=[magnet(), magnet(east_m=99.0)])


def test_the_world_shows_the_field_in_the_mounts_axes(make_world: WorldMaker) -> None:
    # Heading north, mount turned by 90 degrees to the left: its x axis points west.
    mount = Mount(body="chassis", xyz_m=(0.0, 0.0, 0.1), rpy_rad=(0.0, 0.0, math.pi / 2.0))
    world = make_world(kind="orchard_robot", start={"heading_deg": 90.0})
    world.watch("compass", MagneticNeed(mount=mount))
    seen = world.capture("compass")
    assert isinstance(seen, MagneticField)
    east, north, up = world.magnetics.field_ut(seen.position_enu_m, 0.0)
    np.testing.assert_allclose(seen.field_ut, [-east, -north, up], atol=0.01)
    assert seen.position_enu_m[2] == pytest.approx(0.133, abs=1e-3)
    assert seen.motor_current_a == 0.0


def test_a_ramp_between_limits_is_another_in_each_world_and_the_same_in_one() -> None:
    table = {"magnets": [magnet(from_s=1.0, to_s=9.0, ramp_s=[0.5, 3.0])]}
    config = MagneticsConfig.model_validate(table)
    ramps = [config.magnets[0].in_world(seed, 0).ramp_s for seed in range(200)]
    assert ramps == [config.magnets[0].in_world(seed, 0).ramp_s for seed in range(200)]
    assert 0.5 <= min(ramps) < 0.6  # of 200 evenly drawn, one is within 4 % of either end but for 3 cases in 10 000
    assert 2.9 < max(ramps) <= 3.0
    assert config.magnets[0].in_world(7, 0).ramp_s != config.magnets[0].in_world(7, 1).ramp_s
    # Half a ramp after its coming half of it is there.
    place, whole = np.array([1.0, 2.0, 0.7]), np.array([0.0, 0.0, 50.0])
    ramp_s = config.magnets[0].in_world(7, 0).ramp_s
    there = Magnetics(config, GROUND, seed=7).field_ut(place, 1.0 + 0.5 * ramp_s) - magnetics().field_ut(place, 0.0)
    np.testing.assert_allclose(there, 0.5 * whole, atol=1e-9)


def test_limits_of_a_ramp_are_checked() -> None:
    with pytest.raises(ValidationError, match="the lower limit comes first"):
        magnetics(magnets=[magnet(to_s=9.0, ramp_s=[3.0, 0.5])])
    with pytest.raises(ValidationError, match="later than from_s by two ramps"):
        magnetics(magnets=[magnet(from_s=1.0, to_s=6.0, ramp_s=[0.5, 3.0])])
