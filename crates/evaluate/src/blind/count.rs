//! Votes by the key: shares with their intervals, and how far voters agree.

use super::{Ask, Key, Votes};
use crate::{Error, Result};
use kinelm_classify::metrics::wilson;
use kinelm_store::counted;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// What the votes of a study say.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Count {
    /// What was asked.
    pub ask: Ask,
    /// People.
    pub voters: usize,
    /// Their votes in all.
    pub votes: usize,
    /// Of A, of B and, for a blend, of both.
    pub shares: Vec<Share>,
    /// Fleiss' kappa of the answers as they stand on the page, left or right; `None` where it isn't defined.
    pub kappa: Option<f64>,
    /// (trials) the votes for A, for B and, for a blend, for both.
    pub trials: Vec<Vec<usize>>,
}

/// A part of the votes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Share {
    /// The folder, or `both`.
    pub of: String,
    /// Its votes.
    pub votes: usize,
    /// Of all.
    pub share: f64,
    /// Wilson's 95 % interval, as if all votes were independent.
    pub interval: [f64; 2],
}

impl Count {
    /// Counts the votes of some files.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] for a person who is there twice; no votes at all.
    pub fn of(key: &Key, files: &[(&Path, Votes)]) -> Result<Count> {
        for (i, (path, votes)) in files.iter().enumerate() {
            if let Some((other, _)) = files[..i].iter().find(|(_, other)| other.voter == votes.voter) {
                let found = format!("the voter {}, who is in {} too", votes.voter, other.display());
                return Err(Error::file(path, found, "each person once", "leave one of the files out"));
            }
        }
        let choices = key.ask.choices().len();
        let mut seen = vec![vec![0; choices]; key.trials.len()];
        for vote in files.iter().flat_map(|(_, votes)| &votes.votes) {
            seen[vote.trial][vote.choice] += 1;
        }
        let votes: usize = seen.iter().flatten().sum();
        if votes == 0 {
            return Err(Error::unsupported("a count", format!("no votes in {} files", files.len())));
        }
        // the answers on the left and on the right as A and B
        let by_folder = |(trial, seen): (&super::Trial, &Vec<usize>)| {
            let sides = [seen[0], seen[choices - 1]];
            let mut all = vec![sides[trial.left.folder], sides[trial.right.folder]];
            all.extend(&seen[1..choices - 1]);
            all
        };
        let trials: Vec<Vec<usize>> = key.trials.iter().zip(&seen).map(by_folder).collect();
        let names = key.folders.iter().take(2).map(|folder| folder.display().to_string()).chain(["both".into()]);
        let share = |(i, of)| {
            let own: usize = trials.iter().map(|trial| trial[i]).sum();
            Share { of, votes: own, share: own as f64 / votes as f64, interval: wilson(own, votes) }
        };
        let shares = names.take(choices).enumerate().map(share).collect();
        let kappa = fleiss_kappa(&seen);
        Ok(Count { ask: key.ask, voters: files.len(), votes, shares, kappa, trials })
    }
}

/// Fleiss' kappa of (trials, answers) counts: 1 where voters agree in each trial, 0 where they agree as by chance.
///
/// Trials may have different numbers of votes; those of fewer than two say nothing about agreement and don't count.
/// `None` if none is left, or if all votes are one answer.
///
/// Source: Fleiss, "Measuring Nominal Scale Agreement Among Many Raters" (1971); each trial by its own number of votes.
pub fn fleiss_kappa(counts: &[Vec<usize>]) -> Option<f64> {
    let trials: Vec<&Vec<usize>> = counts.iter().filter(|counts| counts.iter().sum::<usize>() > 1).collect();
    let all: f64 = trials.iter().flat_map(|counts| counts.iter()).sum::<usize>() as f64;
    let agreement = |counts: &&Vec<usize>| {
        let n = counts.iter().sum::<usize>() as f64;
        (counts.iter().map(|&k| (k * k) as f64).sum::<f64>() - n) / (n * (n - 1.0))
    };
    let found = trials.iter().map(agreement).sum::<f64>() / trials.len() as f64;
    let answers = trials.first()?.len();
    let share = |answer: usize| trials.iter().map(|counts| counts[answer]).sum::<usize>() as f64 / all;
    let chance: f64 = (0..answers).map(|answer| share(answer).powi(2)).sum();
    (chance < 1.0).then(|| (found - chance) / (1.0 - chance))
}

impl fmt::Display for Count {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [votes, voters] = [(self.votes, "votes"), (self.voters, "voters")].map(|(n, what)| counted(n, what));
        writeln!(f, "{votes} of {voters}, {}", counted(self.trials.len(), "trials"))?;
        for Share { of, votes, share, interval: [low, high] } in &self.shares {
            let [share, low, high] = [share, low, high].map(|x| 100.0 * x);
            writeln!(f, "{of}: {}, {share:.0} % (95 % interval {low:.0} to {high:.0})", counted(*votes, "votes"))?;
        }
        let kappa = self.kappa.map_or("not defined for these votes".into(), |kappa| format!("{kappa:.2}"));
        write!(f, "Fleiss' kappa: {kappa}")
    }
}
