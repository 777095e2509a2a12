# SPDX-License-Identifier: BSD-3-Clause
import pytest

import rangecal


def test_the_table_is_that_of_the_program_to_the_byte(source, command, tmp_path):
    quick = source / "notebooks_data/studies/quick.yaml"
    command("study", quick, "-o", tmp_path / "quick")
    ours = rangecal.study(quick)
    assert ours.results_csv == (tmp_path / "quick/results.csv").read_text()
    frame = ours.to_frame()
    assert len(frame) == len(ours) and {"estimator", "landmark_rmse_m"} <= set(frame.columns)
    assert "estimator" in ours.to_frame(timing=True).columns


def test_fewer_repeats_progress_and_plot(source):
    told = []
    quick = source / "notebooks_data/studies/quick.yaml"
    study = rangecal.study(quick, repeats=5, threads=1, progress=lambda point, fraction: told.append(fraction))
    assert set(study.to_frame()["repeats"]) == {5}
    assert told == sorted(told) and told[-1] == 1.0
    assert study.plot("sigma_theta_deg", "landmark_rmse_m").get_legend()
    assert "<table" in study._repr_html_()


def test_wrong_input_and_interruption(source, tmp_path):
    with pytest.raises(rangecal.InputError, match="none.yaml"):
        rangecal.study(tmp_path / "none.yaml")
    with pytest.raises(rangecal.InputError, match="repeats is 0"):
        rangecal.study(source / "notebooks_data/studies/quick.yaml", repeats=0)

    def refuse(point, fraction):
        raise RuntimeError(point)

    with pytest.raises(RuntimeError, match="sigma_theta_deg"):
        rangecal.study(source / "notebooks_data/studies/quick.yaml", progress=refuse)
