"""MoveIt's ``joint_limits.yaml``, and what of it is refused."""

import tomllib

import pytest

from robots.errors import SetupError
from verifier.cell_filling import fill_in
from verifier.joint_limits_file import joint_limits_text, read_joint_limits
from verifier.recordings.inspection import catalogue

GOOD = """# joint_limits.yaml allows the dynamics properties specified in the URDF to be overwritten
default_velocity_scaling_factor: 0.1
joint_limits:
  elbow_joint:
    has_velocity_limits: true
    max_velocity: 3.1415926535897931
    has_acceleration_limits: false
    max_acceleration: 0
  shoulder_pan_joint:
    has_velocity_limits: true
    max_velocity: 2
    has_acceleration_limits: true
    max_acceleration: 5.0
    min_position: -3.0
    max_position: 3.0
"""


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_limits_that_are_switched_on(tmp_path):
    path = write(tmp_path / "joint_limits.yaml", GOOD)
    rows = read_joint_limits(path)
    assert rows["elbow_joint"] == {"velocity": 3.141592653589793}
    text = joint_limits_text(path, rows, dict.fromkeys(catalogue()["ur5"], "revolute"))
    assert tomllib.loads(text)["robot"]["limits"] == {
        "elbow_joint": {"velocity_rad_s": 3.141592653589793},
        "shoulder_pan_joint": {
            "velocity_rad_s": 2.0,
            "acceleration_rad_s2": 5.0,
            "position_lower_rad": -3.0,
            "position_upper_rad": 3.0,
        },
    }
    assert text.count('# declared in "joint_limits.yaml"') == 5
    filled = fill_in(None, "ur5", None, str(path)).text
    assert text in filled


def table(key, value):
    return f"joint_limits:\n  a:\n    {key}: {value}\n"


GROWN = "a0: &a0 [x]\n" + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 30))
"""As a text, each list is ten times as long as the one before."""


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "has no table joint_limits"),
        ("- 1\n", "has no table joint_limits"),
        ("joint_limits: 3\n", "has no table joint_limits"),
        ("joint_limits:\n  a: 3\n", "joint_limits.a is no table"),
        ("joint_limits: {a: {", "is no YAML that can be read"),
        ("a: 1\na: 2\n", "is no YAML that can be read"),
        ("\t- x", "is no YAML that can be read"),
        ("joint_limits: !!python/object/apply:os.system [ls]\n", "is no YAML that can be read"),
        ("[" * 1100, "is no YAML that can be read"),
        (GROWN + "joint_limits:\n  ? *a29\n  : {}\n", "is no YAML that can be read"),
        (GROWN + table("has_velocity_limits", "*a29"), "has_velocity_limits is a list; write true or false"),
        (
            GROWN + table("has_velocity_limits", "true\n    max_velocity: *a29"),
            "max_velocity is a list; write a number",
        ),
        (table("max_velocity", "2.0"), "has max_velocity and no has_velocity_limits"),
        (table("has_velocity_limits", "yes"), "has_velocity_limits is 'yes'; write true or false"),
        (table("has_velocity_limits", "true"), "max_velocity is None; write a number"),
        (table("has_velocity_limits", "true\n    max_velocity: fast"), "max_velocity is 'fast'"),
        (table("has_velocity_limits", "true\n    max_velocity: true"), "max_velocity is True"),
        (table("has_velocity_limits", "true\n    max_velocity: .nan"), "max_velocity is nan"),
        (table("has_velocity_limits", "true\n    max_velocity: .inf"), "max_velocity is inf"),
        (table("has_velocity_limits", f"true\n    max_velocity: {'9' * 400}"), "max_velocity is 999"),
        (table("has_velocity_limits", "true\n    max_velocity: 0"), "a limit is a finite number above 0"),
        (table("has_velocity_limits", "true\n    max_velocity: -1"), "above 0"),
        (table("has_velocity_limits", "true\n    max_velocity: !degrees 90"), "is no YAML that can be read"),
        (table("min_position", "1"), "has min_position alone"),
        (table("min_position", "1\n    max_position: 1"), "is not below 1"),
    ],
)
def test_limits_that_are_refused(tmp_path, text, why):
    with pytest.raises(SetupError) as caught:
        read_joint_limits(write(tmp_path / "a.yaml", text))
    assert why in str(caught.value) and "\n" not in str(caught.value)


def test_limits_of_another_arm_are_refused(tmp_path):
    path = write(tmp_path / "a.yaml", GOOD)
    with pytest.raises(SetupError, match="has none of the joints panda_joint1"):
        fill_in(None, "panda", None, str(path))


def test_an_alias_is_not_unfolded(tmp_path):
    lines = ["a0: &a0 [x, x]"] + [f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}, *a{k - 1}]" for k in range(1, 60)]
    with pytest.raises(SetupError, match="has no table joint_limits"):
        read_joint_limits(write(tmp_path / "a.yaml", "\n".join(lines)))


def test_a_file_that_is_too_long_or_not_there(tmp_path):
    with pytest.raises(SetupError, match="bytes; a joint_limits"):
        read_joint_limits(write(tmp_path / "a.yaml", "#" * (1 << 21)))
    with pytest.raises(SetupError, match="does not exist"):
        read_joint_limits(tmp_path / "b.yaml")
