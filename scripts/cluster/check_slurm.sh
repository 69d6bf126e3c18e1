#!/bin/sh
# Whether tokenize.sbatch gives the bytes of one machine on a Slurm cluster of two nodes, both on this machine, while tasks at
# work are killed and queued again: scripts/cluster/check_slurm.sh target/release/kinelm DANCES TOKENIZER
#
# As root, in a container (Debian: apt-get install slurm-wlm munge). Its daemons end with it.
set -eu
[ $# = 3 ] || { echo "usage: $0 PROGRAM DANCES TOKENIZER" >&2; exit 2; }
here=$(cd "$(dirname "$0")" && pwd) program=$(realpath "$1") dances=$(realpath "$2") tokenizer=$(realpath "$3")
work=$(mktemp -d)
cd "$work"
host=$(hostname -s)
cat > slurm.conf <<CONF
ClusterName=check
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$work/munge.socket,cred_expire=5
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool.%n
SlurmctldPidFile=$work/controller.pid
SlurmdPidFile=$work/%n.pid
SlurmctldLogFile=$work/controller.log
SlurmdLogFile=$work/%n.log
SlurmctldPort=17000
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
NodeName=n[1-2] NodeHostname=$host NodeAddr=127.0.0.1 Port=[17001-17002] CPUs=1
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE
CONF
export SLURM_CONF="$work/slurm.conf"
ended() {
    for name in n1 n2 controller munge; do
        [ ! -f "$name.pid" ] || kill "$(cat "$name.pid")" 2> /dev/null || true
    done
    rm -rf "$work"
}
trap ended EXIT
trap 'exit 130' INT TERM
mkdir state spool.n1 spool.n2
head -c 1024 /dev/urandom > munge.key
chmod 400 munge.key
munged --force --key-file="$work/munge.key" --socket="$work/munge.socket" --pid-file="$work/munge.pid" \
    --log-file="$work/munge.log" --seed-file="$work/munge.seed" 2> munge.err
slurmctld
slurmd -N n1
slurmd -N n2
until sinfo --noheader --format=%t | grep -q idle; do sleep 0.2; done

"$program" tokenize "$dances" --tokenizer "$tokenizer" --out whole 2> whole.log
# a task takes its time here, or none would be killed at work
printf '#!/bin/sh\nsleep 1.5\nexec "%s" "$@"\n' "$program" > slow
chmod +x slow
job=$(KINELM="$work/slow" sbatch --parsable --array=0-11 --output='%a.log' "$here/tokenize.sbatch" 12 corpus "$dances" \
    --tokenizer "$tokenizer")
merged=$(sbatch --parsable --dependency="afterok:$job" --output=merge.log \
    --wrap "'$program' corpus merge corpus.part* --out corpus")
killed=0
while squeue --noheader --jobs "$merged" | grep -q .; do
    sleep 1
    task=$(squeue --noheader --jobs "$job" --states=RUNNING --format=%i 2> /dev/null | head -n 1)
    # a third of them, while there is work left
    if [ -n "$task" ] && [ "$killed" -lt 4 ] && scontrol requeue "$task"; then
        killed=$((killed + 1))
    fi
done
[ -d corpus ] || { cat ./*.log >&2; exit 1; }
diff -r whole corpus
echo "$killed tasks killed at work; the same bytes: $(ls corpus | tr '\n' ' ')"
[ "$killed" -gt 0 ]
