"""What a run notes of where it is."""

from ddmpi.system.provenance import SLURM, batch_job


def test_a_batch_job_is_noted_where_there_is_one(monkeypatch):
    """By its variables that are set; those of a job that is none count for nothing."""
    for variable in SLURM.values():
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("SLURM_JOB_NODELIST", "node[3-4]")
    assert batch_job() == {}
    monkeypatch.setenv("SLURM_JOB_ID", "12")
    assert batch_job() == {"job_id": "12", "nodes": "node[3-4]"}
