//! A page that asks people: one question about the dancers of each of its trials, votes that stay in the browser, and a
//! button that saves them as a file. It knows nothing of what it shows but the dances.

use crate::data::drawn;
use crate::{ANY_PAGE, Error, Figure, PICK, Result, SOUND, escaped, filled, script};
use serde_json::json;

/// A question about the dancers of some trials.
#[derive(Debug, Clone)]
pub struct Survey<'a> {
    /// The question, the same for all trials.
    pub question: String,
    /// The answers, from left to right; a vote is the index of one, from 0.
    pub choices: Vec<String>,
    /// The dancers of each trial, from left to right, in the order of the trials.
    pub trials: Vec<Vec<Figure<'a>>>,
    /// What saved votes name as their page.
    pub id: String,
}

impl Survey<'_> {
    /// The page as text: about 200 bytes per frame of 24 joints, and 40 KB. The fragment of its address may be `light`
    /// or `dark`.
    ///
    /// # Errors
    /// [`Error::Unsupported`] without a trial or with a single choice; those of [`page`](crate::page) for a trial.
    pub fn html(&self) -> Result<String> {
        let Survey { question, choices, trials, id } = self;
        if trials.is_empty() || choices.len() < 2 {
            let why = format!("{} trials and {} choices; expected 1 and 2 or more", trials.len(), choices.len());
            return Err(Error::unsupported("a survey", why));
        }
        let all = trials.iter().map(|figures| match figures.is_empty() {
            true => Err(Error::unsupported("a trial of no figures", "expected at least one clip")),
            false => drawn(figures),
        });
        let all = all.collect::<Result<Vec<_>>>()?;
        let data = json!({ "page": id, "choices": choices, "trials": all }).to_string();
        let style = [include_str!("player/look.css"), include_str!("survey/survey.css")].concat();
        let parts = [
            ("question", escaped(question)),
            ("style", style),
            ("modules", script(&[SOUND, PICK])),
            ("any_page", ANY_PAGE.into()),
            ("survey", include_str!("survey/survey.js").into()),
            ("data", data.replace('<', "\\u003c")),
        ];
        Ok(filled(include_str!("survey/survey.html"), &parts))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::synth;

    #[test]
    fn a_survey_fetches_nothing_and_says_what_it_lacks() {
        let dance = synth::corpus(1, 1, 1.0, 30.0).unwrap().remove(0).clip;
        let trial = || vec![Figure::new("1", &dance), Figure::new("2", &dance)];
        let survey = |choices: usize, trials| Survey {
            question: "Which <one>?".into(),
            choices: vec!["a</script>".into(); choices],
            trials,
            id: "abc".into(),
        };
        let page = survey(2, vec![trial(), trial()]).html().unwrap();
        for part in ["http:", "https:", "//cdn", "@import", "url(", "{{", "a</script>"] {
            assert!(!page.contains(part), "{part}");
        }
        assert!(
            page.contains("default-src 'none'") && page.contains(crate::MARK) && page.contains("Which &lt;one&gt;?")
        );
        let said = |survey: Survey| survey.html().unwrap_err().to_string();
        assert!(said(survey(1, vec![trial()])).contains("1 trials and 1 choices"));
        assert!(said(survey(2, vec![])).contains("0 trials"));
        assert!(said(survey(2, vec![vec![]])).contains("no figures"));
    }
}
