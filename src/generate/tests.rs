//! Generation with models that are easy to foretell.

use super::*;

/// Wants the token that is the sum of all it has read, plus one, modulo the characters; checks its context.
struct Summing {
    context: usize,
    read: Vec<Vec<u32>>,
    calls: usize,
}

impl NextToken for Summing {
    fn context(&self) -> usize {
        self.context
    }

    fn streams(&self) -> usize {
        self.read.len()
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn truncate(&mut self, stream: usize, length: usize) {
        self.read[stream].truncate(length);
    }

    fn read(&mut self, blocks: &[&[u32]], wanted: Logits, logits: &mut Vec<f32>) -> Result<()> {
        logits.clear();
        self.calls += 1;
        for (read, block) in self.read.iter_mut().zip(blocks) {
            for (i, id) in block.iter().enumerate() {
                read.push(*id);
                assert!(read.len() <= self.context, "{} tokens in {}", read.len(), self.context);
                assert_eq!(read[0], 1, "every window begins with the front token");
                if wanted == Logits::All || i + 1 == block.len() {
                    let mut row = [0.0; 16];
                    row[0] = 99.0; // never allowed
                    row[6 + (read.iter().sum::<u32>() as usize + 1) % 10] = 5.0;
                    logits.extend(row);
                }
            }
        }
        Ok(())
    }
}

fn plan<'a>(frames: usize, given: &'a [bool], prompt: &'a [u32], draw: Draw) -> Plan<'a> {
    Plan { frames, given, prompt, characters: 6..16, bos: 1, space: 5, draw, seed: 7, guesses: 0 }
}

fn model(context: usize, streams: usize) -> Summing {
    Summing { context, read: vec![vec![3; 3]; streams], calls: 0 }
}

fn run(context: usize, plan: &Plan) -> Result<(Vec<u32>, usize)> {
    let mut model = model(context, 1);
    let ids = dance(&mut model, plan, &mut |_| {})?;
    Ok((ids, model.calls))
}

#[test]
fn given_characters_come_out_as_they_went_in() {
    let prompt = [6, 7, 8, 5, 9, 10, 11, 5];
    let given = [false, true, false];
    let (ids, calls) = run(100, &plan(4, &given, &prompt, Draw::Temperature(1.0))).unwrap();
    assert_eq!(ids.len(), 16);
    assert_eq!((ids[1], ids[5]), (7, 10));
    assert!(ids.chunks(4).all(|w| w[3] == 5 && w[..3].iter().all(|id| (6..16).contains(id))));
    // two free places in the two prompted frames, three in the others: known characters cost no call
    assert_eq!(calls, 2 * 2 + 2 * 3);
}

#[test]
fn a_window_that_moves_never_overflows() {
    for context in 8..40 {
        let p = plan(25, &[false, false, false], &[], Draw::Greedy);
        let (ids, _) = run(context, &p).unwrap();
        assert_eq!(ids.len(), 100);
    }
    assert!(run(7, &plan(3, &[false; 3], &[], Draw::Greedy)).unwrap_err().to_string().contains("holds 1 words"));
}

#[test]
fn the_whole_window_is_read_before_it_moves() {
    // as long as everything fits, the sum of all tokens before decides
    let (ids, _) = run(100, &plan(8, &[false; 3], &[], Draw::Greedy)).unwrap();
    let mut sum = 1;
    for word in ids.chunks(4) {
        for &id in &word[..3] {
            assert_eq!(id, 6 + (sum + 1) % 10);
            sum += id;
        }
        sum += 5;
    }
}

#[test]
fn the_same_seed_gives_the_same_dance() {
    let p = plan(20, &[false; 3], &[], Draw::Temperature(3.0));
    assert_eq!(run(30, &p).unwrap(), run(30, &p).unwrap());
    assert_ne!(run(30, &p).unwrap(), run(30, &Plan { seed: 8, ..p.clone() }).unwrap());
}

#[test]
fn everything_given_needs_no_model() {
    let (ids, calls) = run(30, &plan(2, &[true; 3], &[6, 6, 6, 5, 6, 6, 6, 5], Draw::Greedy)).unwrap();
    assert_eq!((ids, calls), (vec![6, 6, 6, 5, 6, 6, 6, 5], 0));
}

#[test]
fn guessing_ahead_changes_no_id_and_saves_reads() {
    let prompt: Vec<u32> = (0..40).map(|i| if i % 4 == 3 { 5 } else { 6 + i * i % 7 }).collect();
    for given in [[false; 3], [false, true, false], [true, false, false], [false, false, true]] {
        // a temperature that makes characters repeat, one that does not, and the likeliest
        for draw in [Draw::Temperature(0.3), Draw::Temperature(9.0), Draw::Greedy] {
            for context in [9, 20, 200] {
                let plain = plan(30, &given, &prompt, draw);
                let (ids, calls) = run(context, &plain).unwrap();
                for guesses in [1, 2, 5] {
                    let mut model = model(context, 1);
                    let found = dances(&mut model, &Plan { guesses, ..plain.clone() }, &mut |_| {}).unwrap();
                    assert_eq!(found.ids, std::slice::from_ref(&ids));
                    assert_eq!(model.calls + found.right as usize, calls);
                    assert!(found.right <= found.guessed && found.guessed > 0);
                }
            }
        }
    }
}

#[test]
fn the_first_of_several_dances_is_the_one_danced_alone() {
    for guesses in [0, 2] {
        let plan = Plan { guesses, ..plan(20, &[false, true, false], &[6, 7, 8, 5], Draw::Temperature(3.0)) };
        let mut model = model(30, 3);
        let mut done = Vec::new();
        let found = dances(&mut model, &plan, &mut |frames| done.push(frames)).unwrap().ids;
        assert_eq!(found[0], run(30, &plan).unwrap().0);
        assert!(found[0] != found[1] && found[0] != found[2] && found[1] != found[2]);
        assert!(found.iter().all(|ids| ids.len() == 80 && ids[1] == 7));
        assert!(done.is_sorted() && done.last() == Some(&20));
        assert!(dance(&mut model, &plan, &mut |_| {}).unwrap_err().to_string().contains("3 sequences"));
    }
}
