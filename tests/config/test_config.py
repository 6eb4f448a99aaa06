"""Configuration: what is refused, with which place, and who wins."""

from pathlib import Path

import pytest

from mocapclean.config.loading import resolve
from mocapclean.config.settings import DEFAULT_METHOD, Grades, Settings
from mocapclean.errors import ConfigError


def written(tmp_path, text):
    path = tmp_path / "studio.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_defaults_are_valid():
    assert resolve(None, {}) == Settings()


def test_the_command_line_wins_over_the_file(tmp_path):
    path = written(tmp_path, "method: spline\nmax_gap: 50\n")
    settings = resolve(path, {"max_gap": 7})
    assert (settings.method, settings.max_gap) == ("spline", 7)


def test_set_reaches_the_chosen_method_and_anything_by_path(tmp_path):
    path = written(tmp_path, "method: trnn2\nmethods:\n  trnn2:\n    second_weight: 3.0\n")
    settings = resolve(path, {}, ("penalty=2.5", "trust.tdd.distance=80"))
    assert settings.params.penalty == 2.5
    assert settings.params.second_weight == 3.0
    assert settings.trust.tdd.distance == 80.0


def test_numbers_in_yaml_are_numbers(tmp_path):
    settings = resolve(written(tmp_path, "trust:\n  tdd:\n    distance: 6e1\n"), {})
    assert settings.trust.tdd.distance == 60.0


def test_paths_are_relative_to_the_file(tmp_path):
    settings = resolve(written(tmp_path, "skeleton: 05.asf\n"), {"gaps": Path("bad.csv")})
    assert settings.skeleton == tmp_path / "05.asf"
    assert settings.gaps == Path("bad.csv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "metod: linear\n",
            r"studio.yaml, line 1: unknown key 'metod'. Did you mean 'method'\? Allowed: config|method",
        ),
        ("method: {linear: 1}\n", r"line 1: method must be a valid string"),
        ("method: magic\n", r"studio.yaml, line 1: method must be .*'trnn2'.*Got 'magic'"),
        (
            "max_gap: 120\nmethods:\n  trnn2:\n    penalti: 1\n",
            r"line 4: unknown key 'methods.trnn2.penalti'. Did you mean 'penalty'",
        ),
        (
            "methods:\n  trnn2:\n    penalty: fast\n",
            r"line 3: methods.trnn2.penalty must be a valid number. Got 'fast'",
        ),
        ("max_gap: '120'\n", r"line 1: max_gap must be a valid integer. Got '120'"),
        ("max_gap: -3\n", r"line 1: max_gap must be greater than 0. Got -3"),
        ("detect: on\n", r"line 1: detect must be a valid boolean. Got 'on'"),
        ("trust:\n  tdd:\n    distance: .nan\n", r"line 3: trust.tdd.distance must be a finite number"),
        ("method: linear\nmethod: spline\n", r"line 2: not valid YAML: found duplicate key"),
        ("max_left: lots\n", r"max_left must be a number of samples or a percentage. Got 'lots'"),
        ("max_error: 0\n", r"line 1: max_error must be greater than 0. Got 0"),
        ("method: linear\nmax_error: 5\n", r"max_error must go with a method that gives error bars: .*dynammo.*linear"),
        ("auto: {methods: []}\n", r"auto.methods must name at least one method. Got none"),
        ("auto: {methods: [spline, magic]}\n", r"line 1: auto.methods.1 must be 'kriging', .*Got 'magic'"),
        ("method: auto\nself_check: false\n", r"method auto needs the self-check"),
        ("method: auto\nmax_error: 5\nauto: {methods: [linear]}\n", r"gives error bars: .*dynammo.*Got linear"),
        ("self_check: maybe\n", r"line 1: self_check must be 'auto' or a valid boolean. Got 'maybe'"),
        ("hiding: {rounds: 0}\n", r"hiding.rounds must be greater than or equal to 1. Got 0"),
        ("grades: {good: 40}\n", r"grades.good must be at most grades.fair, 30. Got 40"),
        ("grades: {fine: 40}\n", r"unknown key 'grades.fine'.*Allowed: fair, good"),
        ("- a\n- b\n", r"line 1: a configuration must be a mapping"),
        ("a: [1\n", r"not valid YAML"),
        ("method: !!python/object:os.system x\n", r"line 1: method must be"),
    ],
)
def test_faults_are_named_with_file_line_and_key(tmp_path, text, message):
    with pytest.raises(ConfigError, match=message):
        resolve(written(tmp_path, text), {})


def test_every_fault_is_named_at_once(tmp_path):
    with pytest.raises(ConfigError) as caught:
        resolve(written(tmp_path, "max_gap: x\nrate: -1\nfoo: 1\n"), {})
    assert len(str(caught.value).splitlines()) == 3


@pytest.mark.parametrize("assignment", ["penalty", "=3", "penalty.x.y=1", "nothing=1", "trust.tdd.distance=abc"])
def test_bad_assignments_are_refused(assignment):
    with pytest.raises(ConfigError):
        resolve(None, {}, (assignment,))


def test_binary_and_absent_files_are_refused(tmp_path):
    path = tmp_path / "studio.yaml"
    with pytest.raises(ConfigError, match="cannot be read"):
        resolve(path, {})
    path.write_bytes(b"method: \xff\xfe\n")
    with pytest.raises(ConfigError, match="byte 8: a configuration must be UTF-8"):
        resolve(path, {})


def test_grades_have_inclusive_limits():
    settings = Settings(grades=Grades(good=2.0, fair=5.0))
    assert [settings.grades.of(expected) for expected in (0.0, 2.0, 2.1, 5.0, 5.1, float("inf"))] == [
        "good",
        "good",
        "fair",
        "fair",
        "poor",
        "poor",
    ]


@pytest.mark.parametrize(
    ("method", "self_check", "checks"),
    [
        (DEFAULT_METHOD, "auto", True),
        ("linear", "auto", True),
        ("auto", "auto", True),
        ("spline", "auto", True),
        ("dynammo", "auto", False),
        ("dynammo", True, True),
        ("linear", False, False),
    ],
)
def test_which_methods_check_themselves(method, self_check, checks):
    assert Settings(method=method, self_check=self_check).checks_itself is checks


@pytest.mark.parametrize(("text", "limit"), [(None, None), (5, 5), ("5", 5), ("2%", 20)])
def test_left_limits_are_counts_or_shares(text, limit):
    assert Settings(max_left=text).left_limit(1000) == limit


HOSTILE = [
    ("an object", "out_dir: !!python/object/apply:os.mkdir [owned]\n", "out_dir must be"),
    (
        "aliases of aliases",
        "a: &a0 [x, x]\n" + "".join(f"k{n}: &a{n + 1} [*a{n}, *a{n}]\n" for n in range(40)),
        "fewer",
    ),
    ("an alias of itself", "&a\nmarkers: *a\n", "fewer than"),
    ("deep nesting", "markers: " + "[" * 400 + "]" * 400 + "\n", "nested too deeply"),
    ("an endless number", "max_gap: " + "9" * 5000 + "\n", "not valid YAML"),
    ("a NUL in a path", 'out_dir: "a\\0b"\n', "out_dir must be a path, without NUL"),
]


@pytest.mark.parametrize(("what", "text", "message"), HOSTILE, ids=[row[0] for row in HOSTILE])
def test_a_hostile_configuration_makes_no_object_and_takes_no_memory(tmp_path, monkeypatch, what, text, message):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "studio.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        resolve(path, {})
    assert not (tmp_path / "owned").exists()
