//! Head groups: the rows of a batch by the table that gives their logits, which is the head over all ids, or one of the two
//! over steps from the previous frame.

use super::config::{HeadKind, ModelConfig, ModelKind, TokenLayout};
use super::previous::{Basis, PreviousFrames, no_bin};
use crate::Result;
use crate::sequence::{Sequence, SequenceLayout};
use kinelm_engine::bins::Bins;
use kinelm_engine::op::cross_entropy::RowTarget;

/// The tables over steps, in the order of the second and third group.
pub(super) const STEPS: [&str; 2] = ["head.circular.weight", "head.clamped.weight"];

/// The rows whose logits come from one table.
#[derive(Debug, Clone, Default)]
pub(super) struct Group {
    /// Their numbers in the batch, ascending.
    pub rows: Vec<u32>,
    /// The target of each.
    pub targets: Vec<RowTarget>,
}

/// The groups of ids, of circular and of clamped steps.
pub(super) type Groups = [Group; 3];

/// Sorts rows into head groups.
#[derive(Debug, Clone)]
pub(super) struct HeadGroups {
    kind: ModelKind,
    head: HeadKind,
    vocabulary: u32,
    pad: u32,
    /// Where slots are of one kind each.
    previous_frames: Option<PreviousFrames>,
    layout: SequenceLayout,
}

impl HeadGroups {
    pub fn of(config: &ModelConfig, tokens: &TokenLayout) -> HeadGroups {
        let layout = SequenceLayout::of(config, tokens);
        let front = layout.front();
        HeadGroups {
            kind: config.kind,
            head: config.head_of(tokens),
            vocabulary: tokens.vocabulary as u32,
            pad: tokens.pad,
            previous_frames: (!tokens.places.is_empty()).then(|| PreviousFrames::new(tokens, front)),
            layout,
        }
    }

    /// Reads previous frames, if the head is relative.
    pub fn steps(&self) -> Option<&PreviousFrames> {
        self.previous_frames.as_ref().filter(|_| self.head == HeadKind::Relative)
    }

    /// The basis of the logits of input `i` of the window of a sequence.
    pub fn basis(&self, sequence: &Sequence, i: usize) -> Basis {
        let known = self.steps().zip(self.layout.at(i));
        known.map_or(Basis::Ids, |(previous_frames, at)| previous_frames.basis(sequence, at))
    }

    /// The most rows of each group in a window of `length` inputs.
    pub fn most_rows(&self, length: usize) -> [usize; 3] {
        let Some(previous_frames) = self.steps() else { return [length, 0, 0] };
        let mut most = [0; 3];
        for i in 0..length {
            let bins = self.layout.at(i).and_then(|at| previous_frames.bins(at));
            let first = self.layout.at(i).is_none_or(|at| !self.layout.has_word_before(at));
            // by slot alone: an input without a bin one frame back moves to ids, but then it has no target
            match bins {
                Some(bins) if !first || self.layout.has_history() => most[1 + usize::from(!bins.circular)] += 1,
                _ => most[0] += 1,
            }
            // where there is a history, a first frame may count from it or not
            most[0] += usize::from(bins.is_some() && first && self.layout.has_history());
        }
        most
    }

    /// The bins of the target of input `i`; `None` where its slot has none.
    fn bins_at(&self, i: usize) -> Option<Bins> {
        // a masked model predicts the input's own token, a causal one the next
        let i = if self.kind == ModelKind::Masked { i.checked_sub(1)? } else { i };
        self.previous_frames.as_ref()?.bins(self.layout.at(i)?)
    }

    /// Fills `groups` with the rows of windows (B of one length) in their sequences whose target (B T) isn't `<pad>`.
    ///
    /// # Errors
    /// Under a relative head, for a target that is no bin of its slot, or whose id one frame back is none.
    pub fn sort<'a>(
        &self,
        sequences: impl ExactSizeIterator<Item = Sequence<'a>>,
        targets: &[u32],
        groups: &mut Groups,
    ) -> Result<()> {
        for Group { rows, targets } in groups.iter_mut() {
            rows.clear();
            targets.clear();
        }
        let length = targets.len() / sequences.len().max(1);
        for (window, sequence) in sequences.enumerate() {
            for (i, &target) in targets[window * length..][..length].iter().enumerate() {
                if target != self.pad {
                    let (group, targets) = self.target_of(&sequence, i, target)?;
                    groups[group].rows.push((window * length + i) as u32);
                    groups[group].targets.push(targets);
                }
            }
        }
        Ok(())
    }

    /// A row's group and target.
    fn target_of(&self, sequence: &Sequence, i: usize, target: u32) -> Result<(usize, RowTarget)> {
        let bins = self.bins_at(i);
        if let (Some(previous_frames), Some(bins), Some(at)) = (self.steps(), bins, self.layout.at(i)) {
            match previous_frames.basis(sequence, at) {
                Basis::Steps { bins, from } => {
                    let bin = bins.bin(target).ok_or_else(|| no_bin("the target", target, bins, i))?;
                    return Ok((usize::from(!bins.circular) + 1, step(previous_frames, bins, from, bin)));
                }
                Basis::Ids => previous_frames.first_frame(sequence.ids, at, bins)?,
            }
        }
        // smoothing spreads a target over neighbouring bins; a space or a label has none
        let bins = bins.filter(|bins| bins.bin(target).is_some()).unwrap_or(Bins::NONE);
        Ok((0, RowTarget { target, first: 0, count: self.vocabulary, bins }))
    }
}

fn step(previous_frames: &PreviousFrames, bins: Bins, from: usize, bin: usize) -> RowTarget {
    let column = |to| previous_frames.steps().column(bins, from, to) as u32;
    // a circular slot's columns begin at step 0, a clamped slot's at the step down to bin 0
    let (first, count) = (if bins.circular { 0 } else { column(0) }, bins.count);
    RowTarget { target: column(bin), first, count, bins: Bins { first, ..bins } }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SlotRun;
    use kinelm_tokenizer::SlotIds;

    /// Words of an angle of 4 bins (ids 6..10), a height of 3 (10..13), a space.
    fn tokens() -> TokenLayout {
        let kind = |first, count, circular| SlotRun { number: 1, kind: SlotIds { first, count, circular } };
        TokenLayout {
            vocabulary: 13,
            word: 3,
            varying: false,
            front: 1,
            pad: 0,
            bos: 1,
            space: 5,
            places: vec![kind(6, 4, true), kind(10, 3, false)],
        }
    }

    fn relative() -> ModelConfig {
        ModelConfig { head: Some(HeadKind::Relative), ..Default::default() }
    }

    fn sort(config: &ModelConfig, inputs: &[u32], targets: &[u32]) -> Result<Groups> {
        let mut groups = Groups::default();
        HeadGroups::of(config, &tokens()).sort(std::iter::once(Sequence::alone(inputs, 3)), targets, &mut groups)?;
        Ok(groups)
    }

    #[test]
    fn rows_go_to_the_table_that_answers() {
        let inputs = [1, 9, 12, 5, 7, 10, 5, 6];
        let targets = [9, 12, 5, 7, 10, 5, 6, 11];
        let [ids, circular, clamped] = sort(&relative(), &inputs, &targets).unwrap();
        assert_eq!([ids.rows, circular.rows, clamped.rows], [vec![0, 1, 2, 5], vec![3, 6], vec![4, 7]]);
        let circle = Bins { first: 0, count: 4, circular: true };
        // 3 to 1 are 2 steps round a circle of 4; 1 to 0 are 3
        assert_eq!(circular.targets[0], RowTarget { target: 2, first: 0, count: 4, bins: circle });
        assert_eq!(circular.targets[1].target, 3);
        // 2 to 0 is the lowest of 5 steps, 0 to 1 the fourth
        let from = |first| Bins { first, count: 3, circular: false };
        assert_eq!(clamped.targets[0], RowTarget { target: 0, first: 0, count: 3, bins: from(0) });
        assert_eq!(clamped.targets[1], RowTarget { target: 3, first: 2, count: 3, bins: from(2) });
        assert_eq!(ids.targets[0].bins, Bins { first: 6, count: 4, circular: true });
        assert_eq!(ids.targets[2], RowTarget { target: 5, first: 0, count: 13, bins: Bins::NONE });
    }

    #[test]
    fn a_masked_model_is_asked_for_what_it_hides() {
        let config = ModelConfig { kind: ModelKind::Masked, ..Default::default() };
        let [ids, circular, clamped] = sort(&config, &[1, 4, 12, 5, 7, 4], &[0, 9, 0, 5, 0, 10]).unwrap();
        assert!(circular.rows.is_empty() && clamped.rows.is_empty());
        assert_eq!(ids.rows, [1, 3, 5]);
        let bins: Vec<u32> = ids.targets.iter().map(|a| a.bins.first).collect();
        assert_eq!(bins, [6, 0, 10]);
    }

    #[test]
    fn every_bin_has_a_step_of_its_own_wherever_a_forecast_leads() {
        use crate::forecast::{BIN, reached};
        let tokens = tokens();
        let steps = HeadGroups::of(&relative(), &tokens).steps().unwrap().steps();
        for (bins, from, forecast) in tokens
            .bins()
            .into_iter()
            .flat_map(|bins| (0..bins.count as usize).map(move |from| (bins, from)))
            .flat_map(|(bins, from)| (-9..=9).map(move |by| (bins, from, by * BIN / 2)))
        {
            let base = reached(bins, from, forecast);
            let found: Vec<RowTarget> = (0..bins.count as usize)
                .map(|bin| step(HeadGroups::of(&relative(), &tokens).steps().unwrap(), bins, base, bin))
                .collect();
            // the same columns for all bins, each of them the target of one bin
            let mut columns: Vec<u32> = found.iter().map(|target| target.target).collect();
            assert!(found.iter().all(|target| (target.first, target.count) == (found[0].first, bins.count)));
            columns.sort_unstable();
            assert!(columns.into_iter().eq(found[0].first..found[0].first + bins.count), "{bins:?} {from} {forecast}");
            let rows = if bins.circular { steps.circular } else { steps.up_and_down() };
            assert!(found[0].first as usize + bins.count as usize <= rows);
        }
    }

    #[test]
    fn what_has_nothing_to_count_from_must_not_count() {
        let config = relative();
        let targets = [0, 12, 5, 0, 10, 5];
        let [ids, circular, clamped] = sort(&config, &[1, 4, 12, 5, 7, 10], &targets).unwrap();
        assert_eq!([ids.rows, circular.rows, clamped.rows], [vec![1, 2, 5], vec![], vec![4]]);
        let said = |inputs: &[u32], targets: &[u32]| sort(&config, inputs, targets).unwrap_err().to_string();
        let message = said(&[1, 4, 12, 5, 7, 10], &[0, 12, 5, 7, 10, 5]);
        assert!(
            message.starts_with("what stands a frame before the target of input 3 is id 4; expected a bin"),
            "{message}"
        );
        let message = said(&[1, 9, 12, 5, 7, 10], &[0, 12, 5, 4, 10, 5]);
        assert!(message.starts_with("the target of input 3 is id 4; expected a bin of its slot, 6 to 9"), "{message}");
        // an absolute head takes what comes
        let absolute = ModelConfig { head: Some(HeadKind::Absolute), ..config.clone() };
        let [ids, ..] = sort(&absolute, &[1, 4, 12, 5, 7, 10], &[0, 12, 5, 4, 10, 5]).unwrap();
        assert_eq!(ids.rows, [1, 2, 3, 4, 5]);
    }
}
