"""Jobs in processes: each has one answer, whatever becomes of its process."""

import os
import pickle
import signal
import subprocess
import sys
import threading
import time

import pytest
from works import Act

from mocapclean.batch.limits import WorkerLimits
from mocapclean.batch.pool import Stop, run
from mocapclean.errors import FormatError, MocapcleanError

LIMITS = WorkerLimits(workers=2, timeout=3.0, memory=500 << 20)


def _errors(kind):
    return [kind, *(found for each in kind.__subclasses__() for found in _errors(each))]


def notes(folder, kind):
    return sorted(int(path.name.split()[1]) for path in folder.glob(f"{kind} *"))


def test_every_job_has_one_answer_whatever_the_others_do(tmp_path):
    acts = ["work", "die", "hang", "work", "crash", "refuse", "devour", "leave", "err", *["work"] * 6]
    jobs = list(enumerate(acts))
    answers = list(run(Act(tmp_path), jobs, LIMITS, Stop()))
    assert sorted(job for job, _ in answers) == jobs
    said = {act: str(answer) for (_, act), answer in answers if isinstance(answer, MocapcleanError)}
    assert "killed by SIGKILL" in said["die"]
    assert "killed by SIGSEGV" in said["crash"]
    assert "longer than the limit of 3 s" in said["hang"]
    assert "not enough memory" in said["devour"]
    assert "exit code 7" in said["leave"]
    assert said["refuse"] == "no answer."
    assert "unexpected KeyError in works.py" in said["err"]
    assert all(answer == 10 * job[0] for job, answer in answers if job[1] == "work")
    assert notes(tmp_path, "undone") == [acts.index(act) for act in ("die", "hang", "crash", "devour", "leave", "err")]


def test_without_workers_the_jobs_are_done_here(tmp_path):
    class Here(Act):
        def work(self, number):
            assert os.getpid() == parent

    parent = os.getpid()
    answers = dict(run(Here(tmp_path), [(4, "work"), (5, "err"), (6, "work")], WorkerLimits(workers=0), Stop()))
    assert answers[4, "work"] == 40
    assert answers[6, "work"] == 60
    assert "unexpected KeyError" in str(answers[5, "err"])


def test_no_jobs_are_no_answers(tmp_path):
    assert list(run(Act(tmp_path), [], LIMITS, Stop())) == []


@pytest.mark.parametrize(("number", "finished"), [(signal.SIGINT, True), (signal.SIGTERM, False)])
def test_asked_to_stop_nothing_more_is_begun(tmp_path, number, finished):
    stop = Stop()
    jobs = [(0, "work"), (1, "rest"), *((n, "work") for n in range(2, 50))]
    answers = []
    for answer in run(Act(tmp_path), jobs, WorkerLimits(workers=2), stop):
        answers.append(answer)
        if len(answers) == 1:
            while len(notes(tmp_path, "begun")) < 3:
                time.sleep(0.01)
            stop(number, None)
    begun, undone = notes(tmp_path, "begun"), notes(tmp_path, "undone")
    assert len(begun) < 6
    assert sorted({job[0] for job, _ in answers} | set(undone)) == begun
    assert not set(undone) & {job[0] for job, _ in answers}
    assert ((1, "rest") in dict(answers)) == finished
    with pytest.raises(KeyboardInterrupt):
        stop(number, None)


def test_stopped_at_once_the_processes_are_gone_and_what_ran_is_undone(tmp_path):
    jobs = [(0, "work"), (1, "hang"), (2, "hang")]
    answers = run(Act(tmp_path), jobs, WorkerLimits(workers=2), Stop())
    assert next(answers) == (jobs[0], 0)
    while len(notes(tmp_path, "begun")) < 3:
        time.sleep(0.01)
    answers.close()
    assert notes(tmp_path, "undone") == [1, 2]


def test_nobody_is_left_when_the_parent_is_killed(tmp_path):
    code = f"""
import sys; sys.path.insert(0, {os.path.dirname(__file__)!r})
from pathlib import Path
from works import Act
from mocapclean.batch.limits import WorkerLimits
from mocapclean.batch.pool import Stop, run
if __name__ == "__main__":
    list(run(Act(Path(sys.argv[1])), [(0, "hang"), (1, "hang")], WorkerLimits(workers=2), Stop()))
"""
    (tmp_path / "parent.py").write_text(code)
    process = subprocess.Popen([sys.executable, tmp_path / "parent.py", tmp_path], start_new_session=True)
    while len(notes(tmp_path, "begun")) < 2:
        assert process.poll() is None
        time.sleep(0.05)
    process.kill()
    process.wait()
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and _session(process.pid):
        time.sleep(0.05)
    assert _session(process.pid) == []


def _session(leader):
    """The processes of a session, by number."""
    found = []
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{name}/stat", "rb") as file:
                state, _, _, session = file.read().rpartition(b")")[2].split()[:4]
        except OSError:
            continue
        if int(session) == leader and state != b"Z":
            found.append(int(name))
    return found


def test_a_stop_may_come_from_anywhere(tmp_path):
    stop = Stop()
    threading.Timer(0.5, stop, (signal.SIGTERM, None)).start()
    assert list(run(Act(tmp_path), [(0, "hang"), (1, "hang")], WorkerLimits(workers=2), stop)) == []
    assert notes(tmp_path, "undone") == [0, 1]


@pytest.mark.parametrize("kind", _errors(MocapcleanError), ids=lambda kind: kind.__name__)
def test_every_error_passes_between_processes(kind):
    places = {"line": 3, "byte": 7, "frame": 9, "marker": "LASI"}
    fault = kind("take.c3d", "is broken.", **places) if kind is FormatError else kind("is broken.")
    back = pickle.loads(pickle.dumps(fault))
    assert (type(back), str(back), vars(back)) == (kind, str(fault), vars(fault))
