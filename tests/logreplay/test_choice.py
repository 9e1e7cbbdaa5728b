"""Estimators by name, with variants, options and the sensors that they can use."""

from __future__ import annotations

import dataclasses
from importlib.metadata import EntryPoint

import pytest

from tests.logs import MOUNT, MadeUpLog, receiver
from twin.errors import BadInputError
from twin.logreplay import choose, is_built_in, read_settings
from twin.logreplay.replaying import log_setup
from twin.signals import EstimatorSetup, SensorInfo

ODOMETRY = SensorInfo(
    name="wheels", kind="odometry", columns=("speed_m_s", "yaw_rate_rad_s"), mount=MOUNT, rate_hz=10.0
)
CAMERA = SensorInfo(name="camera", kind="camera", columns=("sign_seen",), mount=MOUNT, rate_hz=2.0)


def setup(*sensors: SensorInfo, **vehicle: object) -> EstimatorSetup:
    told = [f"vehicle.{key}={value}" for key, value in vehicle.items()]
    log = MadeUpLog([], sensors=sensors)
    first = next((info for info in sensors if info.kind == "gnss"), None)
    return log_setup(log, first, (1.0, 2.0, 0.5), read_settings(told).vehicle)


def test_a_kind_hears_what_it_can_use() -> None:
    (gps, pv) = choose(["guidance_gps", "guidance_pv"])
    around = setup(receiver(), CAMERA, ODOMETRY, receiver(name="second"))
    assert gps.build(around)[1] == ("gnss",)
    assert pv.build(around)[1] == ("gnss", "wheels")


def test_sensors_may_be_named() -> None:
    (pv,) = choose(["guidance_pv"], options={"guidance_pv": {"sensors": ["second"]}})
    assert pv.build(setup(receiver(), ODOMETRY, receiver(name="second")))[1] == ("second",)
    (lost,) = choose(["guidance_pv"], options={"guidance_pv": {"sensors": ["seconds"]}})
    with pytest.raises(BadInputError, match=r"guidance_pv.*'seconds'; did you mean 'second'"):
        lost.build(setup(receiver(), receiver(name="second")))


def test_variants_have_names_and_options() -> None:
    texts = ["cv=guidance_kinematic:model=constant_velocity", "ca=guidance_kinematic:model=constant_acceleration"]
    cv, ca = choose(texts, options={"ca": {"variant": "corrected"}})
    assert (cv.name, cv.kind, cv.options) == ("cv", "guidance_kinematic", {"model": "constant_velocity"})
    assert ca.options == {"model": "constant_acceleration", "variant": "corrected"}
    assert cv.build(setup(receiver()))[0].columns


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["guidance_gsp"], "unknown kind 'guidance_gsp'; did you mean 'guidance_gps'"),
        (["guidance_gps", "guidance_gps"], "two of that name"),
        (["truth=guidance_gps"], "reserved"),
        (["../x=guidance_gps"], "plain name"),
        (["a.b=guidance_gps"], "dot"),
    ],
)
def test_wrong_names_are_refused(texts: list[str], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        choose(texts)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "cv=guidance_kinematic:models=constant_velocity",
            r"estimators\.cv\.models: unknown key; did you mean 'model'",
        ),
        ("cv=guidance_kinematic:model=fast", r"estimators\.cv\.model: given 'fast'"),
        ("heading_madgwick", "heading_madgwick"),
    ],
)
def test_wrong_options_and_sensors_are_told_when_it_is_built(text: str, message: str) -> None:
    (choice,) = choose([text])
    with pytest.raises(BadInputError, match=message):
        choice.build(setup(receiver()))


def test_options_for_nobody_are_refused() -> None:
    with pytest.raises(BadInputError, match=r"estimators\.guidance_pv.*there are guidance_gps"):
        choose(["guidance_gps"], options={"guidance_pv": {"rate_hz": 1.0}})
    with pytest.raises(BadInputError, match=r"vehicle\.wheelbas.*did you mean 'wheelbase_m'"):
        read_settings(["vehicle.wheelbas=2.0"])


def test_a_class_of_the_users_own_is_told_from_a_kind() -> None:
    assert is_built_in("guidance_pv")
    assert is_built_in("cv=guidance_kinematic:model=constant_velocity")
    assert not is_built_in("my_module:Filter")
    assert is_built_in("guidence_pv")  # misspelt: choose() says which was meant


def test_a_registered_class_is_told_from_a_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint(name="mine", value="module:Filter", group="twin.estimators")
    monkeypatch.setattr("twin.logreplay.choice.registered", lambda: {"mine": point})
    assert not is_built_in("mine")
    with pytest.raises(BadInputError, match="did you mean 'guidance_pv'"):
        choose(["guidence_pv"])


def test_the_antenna_is_the_reference_frame_unless_told() -> None:
    plain = setup(receiver())
    assert plain.reference == MOUNT
    assert (plain.wheelbase_m, plain.start_e_n_heading) == (0.0, (1.0, 2.0, 0.5))
    told = setup(receiver(), antenna_xyz_m=[0.5, 0.0, 2.0], wheelbase_m=2.4)
    assert told.reference == dataclasses.replace(MOUNT, xyz_m=(-0.5, 0.0, -2.0))
    assert told.wheelbase_m == 2.4
