"""Stages reach the listener, and nobody else."""

import os

import pytest

from mocapclean import progress


class Recorder:
    def __init__(self):
        self.heard = []

    def stage(self, name, total):
        self.heard.append((name, total))

    def advance(self, n):
        self.heard.append(n)


def test_without_a_listener_nothing_happens():
    progress.stage("filling", 3)
    progress.advance()
    with progress.within("self-check"):
        progress.stage("filling")


def test_a_listener_hears_of_stages_and_steps_inside_its_block_alone():
    recorder = Recorder()
    with progress.shown_by(recorder):
        progress.stage("filling", 3)
        progress.advance()
        progress.advance(2)
        progress.stage("writing")
    progress.stage("reading")
    assert recorder.heard == [("filling", 3), 1, 2, ("writing", 0)]


def test_parts_of_a_stage_are_shown_under_its_name_until_it_ends():
    def check_itself():
        with progress.within("self-check"):
            progress.stage("filling", 2)
            with progress.within("detecting"):
                progress.stage("filling", 5)
            raise ValueError("stop")

    recorder = Recorder()
    with progress.shown_by(recorder):
        with pytest.raises(ValueError, match="stop"):
            check_itself()
        progress.stage("filling", 4)
    names = ["self-check"] * 4 + ["filling"]
    assert recorder.heard == list(zip(names, (0, 2, 0, 5, 4), strict=True))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_forked_process_has_no_listener():
    recorder = Recorder()
    with progress.shown_by(recorder):
        child = os.fork()
        if not child:
            progress.stage("filling", 3)
            os._exit(len(recorder.heard))
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
        progress.stage("writing")
    assert recorder.heard == [("writing", 0)]
