from __future__ import annotations

import math
import pickle
import subprocess
import sys
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from tests.estimators.planter import STEP_NS, make_setup, radar
from twin.errors import BadInputError
from twin.estimators import AdaptedEstimator, EstimatorConfigUnion, build_estimator, load_class
from twin.estimators import adapter as adapter_module
from twin.signals import Estimate


class Smoothed:
    """A ten-line filter as a user would write it."""

    columns = ("speed_m_s", "bias_m_s")

    def __init__(self, setup, gain: float = 0.5) -> None:
        assert setup.runs == 1
        self.speed, self.gain = 0.0, gain

    def process(self, sample) -> None:
        self.speed += self.gain * (sample["speed_m_s"] - self.speed)

    def estimate(self, t: float):
        return {"bias_m_s": t, "speed_m_s": (self.speed, 0.1)}


class Whole(Smoothed):
    columns = ("speed_m_s",)
    state_columns = ("speed_m_s",)

    def estimate(self, t: float) -> Estimate:  # noqa: ARG002
        return Estimate(t_ns=0, values=np.array([self.speed]), sigmas=np.array([0.2]), covariance=np.array([[0.04]]))


def test_one_class_serves_every_member() -> None:
    lifted = AdaptedEstimator(Smoothed, make_setup(runs=3), {"gain": 1.0})
    lifted.process(radar(STEP_NS, [1.0, 2.0, 3.0], valid=[True, False, True]))
    estimate = lifted.estimate(STEP_NS)
    np.testing.assert_allclose(estimate.values, [[1.0, 0.02], [0.0, 0.02], [3.0, 0.02]])
    np.testing.assert_array_equal(estimate.sigmas[:, 0], 0.1)
    assert np.isnan(estimate.sigmas[:, 1]).all()
    assert estimate.covariance is None


def test_an_estimate_with_covariance_is_lifted_too() -> None:
    lifted = AdaptedEstimator(Whole, make_setup(runs=2))
    lifted.process(radar(STEP_NS, [1.0, 2.0]))
    estimate = lifted.estimate(STEP_NS)
    assert lifted.state_columns == ("speed_m_s",)
    assert estimate.covariance is not None
    assert estimate.covariance.shape == (2, 1, 1)
    np.testing.assert_allclose(estimate.values, [[0.5], [1.0]])


def test_classes_load_by_module_path() -> None:
    assert load_class("tests.estimators.test_adapter:Smoothed") is Smoothed


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("nowhere.at.all:Filter", "cannot import"),
        ("tests.estimators.test_adapter:Nothing", "no class 'Nothing'"),
        ("tests.estimators.test_adapter:STEP_NS", "no class 'STEP_NS'"),
        ("justaname", "expected package.module:Class"),
        ("../evil:Class", "expected package.module:Class"),
        (":Class", "expected package.module:Class"),
    ],
)
def test_what_cannot_be_loaded_says_why(spec: str, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        load_class(spec)


def test_entry_points_are_found_and_take_options(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [
        EntryPoint("smoothed", "tests.estimators.test_adapter:Smoothed", "twin.estimators"),
        EntryPoint("broken", "nowhere.at.all:Filter", "twin.estimators"),
    ]
    monkeypatch.setattr(adapter_module, "entry_points", lambda group: points if group == "twin.estimators" else [])

    def build(name: str, **options: object):
        section = {"kind": "plugin", "name": name, "sensors": ["radar"], "options": options}
        return build_estimator(TypeAdapter(EstimatorConfigUnion).validate_python(section), make_setup())

    assert build("smoothed", gain=0.1).columns == Smoothed.columns
    with pytest.raises(BadInputError, match=r"gain_typo"):
        build("smoothed", gain_typo=0.1)
    with pytest.raises(BadInputError, match="cannot load 'nowhere"):
        build("broken")
    with pytest.raises(BadInputError, match="known: broken, smoothed"):
        build("absent")


@pytest.mark.parametrize(
    ("reported", "message"),
    [
        ({"speed_m_s": 1.0}, "declared are speed_m_s, bias_m_s"),
        ({"speed_m_s": "fast", "bias_m_s": 0.0}, "must be numbers"),
        (None, "gave NoneType"),
        ({"speed_m_s": (1.0, -0.5), "bias_m_s": 0.0}, r"Wrong\): estimate\(\) gave speed_m_s a negative sigma, -0.5$"),
        (Estimate(t_ns=0, values=np.zeros(2), sigmas=np.array([math.nan, -1.0])), "gave bias_m_s a negative sigma"),
        (Estimate(t_ns=0, values=np.zeros(3), sigmas=np.zeros(2)), r"values has shape \(3,\), expected \(2,\)"),
    ],
)
def test_estimates_that_do_not_fit_are_bad_input(reported, message: str) -> None:
    class Wrong(Smoothed):
        def estimate(self, t: float):  # noqa: ARG002
            return reported

    with pytest.raises(BadInputError, match=message):
        AdaptedEstimator(Wrong, make_setup()).estimate(0)


def test_a_class_without_columns_or_methods_is_bad_input() -> None:
    class NoColumns(Smoothed):
        columns = ()

    class NoMethods:
        columns = ("speed_m_s",)

        def __init__(self, setup) -> None: ...

    with pytest.raises(BadInputError, match="columns must be a tuple"):
        AdaptedEstimator(NoColumns, make_setup())
    with pytest.raises(BadInputError, match=r"has no method process\(\)"):
        AdaptedEstimator(NoMethods, make_setup())


def test_configuration_is_discriminated_and_strict() -> None:
    union = TypeAdapter(EstimatorConfigUnion)
    assert union.validate_python({"kind": "row_speed_ekf", "sensors": ["imu_1"]}).noise.radar_m2_s2 == 0.1
    for bad in (
        {"kind": "nonsense", "sensors": []},
        {"kind": "row_speed_ekf", "sensors": ["imu_1"], "noise": {"process": [1e-5, 1e-5, 1e-4, 1e-8]}},
        {"kind": "row_speed_ekf", "sensors": ["imu_1"], "noise": {"radar_m2_s2": 0.0}},
        {"kind": "row_speed_ekf", "sensors": ["imu_1"], "rate": 50.0},
    ):
        with pytest.raises(ValidationError):
            union.validate_python(bad)


def test_importing_the_package_does_not_import_filterpy() -> None:
    code = "import sys, twin.estimators; sys.exit('filterpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


class Faulty(Smoothed):
    def process(self, sample) -> None:  # noqa: ARG002
        np.linalg.inv(np.zeros((2, 2)))

    def estimate(self, t: float):  # noqa: ARG002
        return {"speed_m_s": 1.0 / self.speed}


def test_an_exception_of_the_users_code_is_bad_input_that_says_whose_and_where() -> None:
    class Unmade(Smoothed):
        def __init__(self, setup) -> None:  # noqa: ARG002
            self.speed = {}["x"]

    with pytest.raises(BadInputError, match=r"Unmade\): __init__\(\) raised KeyError: 'x' at test_adapter.py:\d+$"):
        AdaptedEstimator(Unmade, make_setup())
    lifted = AdaptedEstimator(Faulty, make_setup())
    who = r"^estimator central \(tests.estimators.test_adapter:Faulty\): "
    with pytest.raises(
        BadInputError, match=who + r"process\(\) raised LinAlgError: .* at test_adapter.py:\d+$"
    ) as told:
        lifted.process(radar(STEP_NS, [1.0]))
    trace = told.value.trace.splitlines()
    assert trace[0] == "Traceback (most recent call last):"
    assert "test_adapter.py" in trace[1]  # its own frames and those below, none of ours
    assert "numpy" in told.value.trace
    assert trace[-1].endswith("Singular matrix")
    with pytest.raises(BadInputError, match=who + r"estimate\(\) raised ZeroDivisionError: .* at test_adapter.py:\d+$"):
        lifted.estimate(STEP_NS)


def test_a_method_that_takes_other_things_is_bad_input() -> None:
    class Deaf(Smoothed):
        def process(self) -> None: ...

    with pytest.raises(BadInputError, match=r"process\(\) raised TypeError: .* 1 positional argument but 2") as told:
        AdaptedEstimator(Deaf, make_setup()).process(radar(STEP_NS, [1.0]))
    assert told.value.trace == ""


def test_a_sample_says_which_columns_there_are() -> None:
    class Misspelt(Smoothed):
        def process(self, sample) -> None:
            self.speed = sample["sped_m_s"]

    says = r"""KeyError: "'radar' gives no 'sped_m_s'; did you mean 'speed_m_s'\? \(there are speed_m_s\)" at test_"""
    with pytest.raises(BadInputError, match=says):
        AdaptedEstimator(Misspelt, make_setup()).process(radar(STEP_NS, [1.0]))


def test_what_a_module_raises_while_it_is_imported_is_bad_input(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "raises_at_import.py").write_text("import math\n\nGAIN = math.sqrt(-1.0)\n")
    (tmp_path / "is_no_python.py").write_text("class Mine(\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(BadInputError, match=r"importing 'raises_at_import' raised ValueError: .*import.py:3$"):
        load_class("raises_at_import:Mine")
    with pytest.raises(BadInputError, match=r"raised SyntaxError: .*is_no_python.py, line 1") as told:
        load_class("is_no_python:Mine")
    assert "class Mine(" in told.value.trace


def test_an_error_of_the_users_code_keeps_its_traceback_behind_a_name_and_between_processes() -> None:
    error = BadInputError("cannot be used", trace="Traceback\n").within("some.toml")
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.trace) == ("some.toml: cannot be used", "Traceback\n")
