"""What solvers say of a run: the same numbers from a binout and from text, and what is not written is not recorded."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crashfuse.campaign_folder.load import load_campaign
from crashfuse.errors import DataError
from crashfuse.importing import import_source, settle
from crashfuse.readers.energies import Energies as Histories
from crashfuse.readers.lsdyna.runs import read_lsdyna
from crashfuse.run_quality import RunQuality
from tests.readers.lsdyna_files import Energies, Run, lsda
from tests.readers.test_lsdyna import WEIGHTS, only, saved

RUN = Run(end_s=0.12, step_s=5e-4)
TOLD = Energies()
QUALITY = RunQuality(-0.04, 0.05, 0.025)
"""By hand: 97 - 1 of 100 in between, 4 of 80, 2.5 %."""


def binout(*energies: dict[str, dict[str, np.ndarray]]) -> bytes:
    """A binout of the run with these energies."""
    folders = {name: content for name, content in RUN.folders().items() if "glstat" not in name}
    for more in energies:
        folders |= more
    return lsda(folders)


@pytest.mark.parametrize("form", ["in the binout", "as text", "as text beside a nodout"])
def test_quality_is_that_of_glstat_in_any_form(tmp_path: Path, form: str) -> None:
    """The largest change of energy less the work from outside, and the largest shares."""
    files = {
        "in the binout": {"binout0000": binout(TOLD.glstat_folders())},
        "as text": {"binout0000": binout(), "glstat": TOLD.glstat()},
        "as text beside a nodout": {"nodout": RUN.nodout(), "glstat.txt": TOLD.glstat()},
    }[form]
    record = only(saved(tmp_path / "run7", **files))
    found = record.quality
    assert found.energy_change == pytest.approx(-0.04)
    assert found.hourglass_share == pytest.approx(0.05)
    assert found.added_mass_share == pytest.approx(0.025)
    assert (
        "Run quality (glstat, matsum): energy change −4 % of the energy at the start, hourglass energy 5 % of the "
        "largest internal energy, added mass 2.5 % of the mass at the start."
    ) in record.steps
    assert settle(record, WEIGHTS, role="cae").quality == found
    assert settle(record, WEIGHTS, role="tests").quality == RunQuality()


@pytest.mark.parametrize("form", ["in the binout", "as text"])
def test_parts_are_summed_where_the_whole_is_not_told(tmp_path: Path, form: str) -> None:
    """Hourglass energy of matsum; the rest is not recorded."""
    without = replace(TOLD, hourglass=None, added_percent=None)
    files = {
        "in the binout": {"binout0000": binout(without.glstat_folders(), TOLD.matsum_folders())},
        "as text": {"binout0000": binout(), "glstat": without.glstat(), "matsum": TOLD.matsum()},
    }[form]
    found = only(saved(tmp_path / "run7", **files)).quality
    assert found.energy_change == pytest.approx(-0.04)
    assert found.hourglass_share == pytest.approx(0.05)
    assert found.added_mass_share is None


def test_hourglass_energy_that_is_not_computed_is_not_recorded(tmp_path: Path) -> None:
    """LS-DYNA writes zeros where the model does not ask for it."""
    zeros = replace(TOLD, hourglass=(0.0, 0.0, 0.0))
    record = only(saved(tmp_path / "run7", binout0000=binout(zeros.glstat_folders(), zeros.matsum_folders())))
    assert record.quality.hourglass_share is None
    assert any("hourglass energy not recorded" in step for step in record.steps)


def test_shards_and_restarts_are_one_history(tmp_path: Path) -> None:
    """States from several files, in order of time."""
    first, later = TOLD.glstat_folders(), TOLD.glstat_folders()
    del first["/glstat/d000003"], later["/glstat/d000001"]
    shards = {"binout0000": binout(later), "binout0001": lsda(first)}
    found = only(saved(tmp_path / "run7", **shards)).quality
    assert found.energy_change == pytest.approx(-0.04)


def test_a_run_killed_while_it_wrote_its_energies_is_judged_by_the_states_before(tmp_path: Path) -> None:
    """The last state has its work but not yet its total energy."""
    whole = TOLD.glstat()
    cut = whole[: whole.rindex(b" total energy...")]
    found = only(saved(tmp_path / "run7", binout0000=binout(), glstat=cut)).quality
    assert found.energy_change == pytest.approx(-0.04)


def test_a_run_without_energies_says_so(tmp_path: Path) -> None:
    """Nothing is recorded, and nothing is made up."""
    record = only(saved(tmp_path / "run7", binout0000=binout()))
    assert record.quality == RunQuality()
    assert any("energy change not recorded, hourglass energy not recorded" in step for step in record.steps)


def test_energies_alone_are_no_run(tmp_path: Path) -> None:
    """A folder with glstat but no nodes is passed over beside others, and refused alone."""
    saved(tmp_path / "doe" / "a", binout0000=binout(TOLD.glstat_folders()))
    saved(tmp_path / "doe" / "b", glstat=TOLD.glstat())
    assert [record.id for record in read_lsdyna(tmp_path / "doe")] == ["a"]
    with pytest.raises(DataError, match="expected binout or nodout of LS-DYNA, found none"):
        read_lsdyna(tmp_path / "doe" / "b")


def test_a_damaged_glstat_is_told(tmp_path: Path) -> None:
    """In one sentence, with its name."""
    damaged = TOLD.glstat().replace(b"8.00000E+01", b"8.00-00E+01")
    with pytest.raises(DataError, match=r"glstat: expected numbers, found '8.00-00E\+01'; copy it again"):
        read_lsdyna(saved(tmp_path / "run7", binout0000=binout(), glstat=damaged))


@pytest.mark.parametrize(
    ("histories", "quality"),
    [
        (Histories(), RunQuality()),
        (Histories(total=np.array([0.0, 1.0]), work=np.zeros(2)), RunQuality()),
        (Histories(total=np.array([1.0, np.nan]), work=np.zeros(2)), RunQuality()),
        (Histories(total=np.array([1.0, 1.2]), work=np.array([0.5, 0.7])), RunQuality(0.0)),
        (Histories(total=np.array([1.0, 9.0]), work=np.zeros(2)), RunQuality(1.0)),
        (Histories(internal=np.zeros(2), hourglass=np.zeros(2)), RunQuality()),
        (Histories(internal=np.array([0.0, 2.0]), hourglass=np.array([0.0, -1e-9])), RunQuality(hourglass_share=0.0)),
        (Histories(added_mass=np.array([0.1, 3.0])), RunQuality(added_mass_share=1.0)),
    ],
)
def test_quality_follows_from_the_histories(histories: Histories, quality: RunQuality) -> None:
    """What can't be computed is not recorded; what lies beyond the whole counts as all of it."""
    found = histories.quality
    assert (found.hourglass_share, found.added_mass_share) == (quality.hourglass_share, quality.added_mass_share)
    assert found.energy_change == (None if quality.energy_change is None else pytest.approx(quality.energy_change))


def test_quality_comes_into_the_campaign_with_the_run(tmp_path: Path, campaign_folder: Path) -> None:
    """Imported as a CAE run it is in cae.csv; imported as a test there is nothing to say."""
    source = saved(tmp_path / "run7", binout0000=binout(TOLD.glstat_folders()))
    import_source(source, campaign_folder, WEIGHTS, role="cae")
    import_source(source, campaign_folder, WEIGHTS, role="tests")
    campaign = load_campaign(campaign_folder)
    assert campaign.cae.quality[-1].energy_change == pytest.approx(QUALITY.energy_change)
    assert campaign.cae.quality[0] == RunQuality()
    assert "energy_change" not in (campaign_folder / "tests.csv").read_text()
