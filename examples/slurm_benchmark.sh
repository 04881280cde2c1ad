#!/bin/bash
#SBATCH --job-name=morphkit
#SBATCH --array=0-7
#SBATCH --cpus-per-task=1
#SBATCH --mem=8G
#SBATCH --time=04:00:00
#SBATCH --signal=B:TERM@120
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --output=slurm-%A_%a.log
# Several workers on one matrix: each cell is run by one of them. When the time is nearly up, a worker stops at a
# checkpoint and queues itself again.
#
#   sbatch examples/slurm_benchmark.sh --task all --split all --method limb-former --seeds 2 --out /shared/matrix

export OMP_NUM_THREADS=${SLURM_CPUS_PER_TASK:-1}
morphkit benchmark run "$@" --quiet &
work=$!
trap 'kill -TERM "$work"' TERM
wait "$work"
code=$?
if [ "$code" = 143 ]; then  # of the trap, which ends the first wait, or of the worker
    wait "$work"
    code=$?
    scontrol requeue "${SLURM_ARRAY_JOB_ID}_${SLURM_ARRAY_TASK_ID}"
fi
exit "$code"
