"""The bicycle's page: the paper's two gaps in figures and numbers, and what the paper leaves open."""

import re

from hil.ui.reproduce import bicycle_report


def test_the_page_tells_the_story_and_keeps_the_rides(tmp_path):
    said = []
    report = bicycle_report(tmp_path / "page.html", tmp_path / "runs", None, said.append)
    text = report.path.read_text()
    for figure in (
        "Figure 5",
        "Figure 6",
        "Figure 7",
        "Figure 8",
        "Figures 9 and 10",
        "Beyond the paper",
    ):
        assert figure in text
    facts = report.facts
    assert facts["integration_m"] < 1e-4, "the integration is not to blame"
    assert facts["steer_step_m"] > 1.0, "one step of the steer encoder is"
    assert facts["pitch_rms"] > 4.0 * facts["yaw_rms"]
    assert facts["pitch_larger"] > 1.01
    assert facts["forward_filtered_rms"] < facts["forward_rms"]
    assert abs(facts["reduced_inertia_off_rms"]) < 3.0
    assert facts["pitch_after"] < 0.8 * facts["pitch_before"]
    assert facts["shrink"] > 0.7
    assert "front suspension" in text
    assert sorted(p.name for p in (tmp_path / "runs").iterdir()) == ["slalom", "u-turns"]
    outside = re.findall(
        r'(?:src|href)="(?!data:)[^"]+"', re.sub(r"<script.*?</script>", "", text, flags=re.S)
    )
    assert outside == []
    assert len(said) == 3
