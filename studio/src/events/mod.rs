//! Events for all open pages: numbered, in memory for a while, so that a page that was away gets what it missed.
//!
//! There is one ring for everybody and a cursor for each page: a slow page costs no memory; where the ring has moved
//! on, it has to load the state again.

use serde::Serialize;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};
use tokio::sync::watch;

/// The most events in memory, and their bytes.
const MOST_EVENTS: usize = 8192;
const MOST_BYTES: usize = 16 << 20;

/// The events of a studio.
#[derive(Debug)]
pub struct Hub {
    ring: Mutex<Ring>,
    last: watch::Sender<u64>,
}

#[derive(Debug)]
struct Ring {
    events: VecDeque<(u64, Arc<str>)>,
    bytes: usize,
    last: u64,
}

impl Ring {
    /// The number before the first event.
    fn first(&self) -> u64 {
        self.events.front().map_or(self.last, |(first, _)| first - 1)
    }
}

impl Default for Hub {
    fn default() -> Hub {
        // a number of a server that ran earlier is below all of ours, so its page loads the state again
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        // room for 1,000 events in each millisecond until the next start, and exact in a page's numbers (below 2^53)
        let last = since.as_millis() as u64 * 1000;
        let ring = Ring { events: VecDeque::new(), bytes: 0, last };
        Hub { ring: Mutex::new(ring), last: watch::Sender::new(last) }
    }
}

impl Hub {
    fn ring(&self) -> MutexGuard<'_, Ring> {
        self.ring.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sends an event to all pages.
    pub fn send(&self, name: &str, data: &impl Serialize) {
        // one line: JSON has no raw line breaks, which would end the event
        let data = serde_json::to_string(data).unwrap_or_else(|_| "{}".into());
        let mut ring = self.ring();
        ring.last += 1;
        let id = ring.last;
        let text: Arc<str> = framed(id, name, &data).into();
        ring.bytes += text.len();
        ring.events.push_back((id, text));
        while ring.events.len() > MOST_EVENTS || (ring.bytes > MOST_BYTES && ring.events.len() > 1) {
            let Some((_, gone)) = ring.events.pop_front() else { break };
            ring.bytes -= gone.len();
        }
        // before pages wake: they take the lock at once
        drop(ring);
        self.last.send_replace(id);
    }

    /// The number of the last event.
    pub fn last(&self) -> u64 {
        self.ring().last
    }

    /// `id`, or the number before the first event that is still there.
    pub fn kept_since(&self, id: u64) -> u64 {
        let ring = self.ring();
        id.clamp(ring.first(), ring.last)
    }

    /// The events after `id`, and the number of the last; `None` if some of them are no longer in memory, or `id` isn't
    /// one of ours.
    pub fn since(&self, id: u64) -> Option<(Vec<Arc<str>>, u64)> {
        let ring = self.ring();
        let first = ring.first();
        if id < first || id > ring.last {
            return None;
        }
        let after = ring.events.iter().skip((id - first) as usize);
        Some((after.map(|(_, text)| text.clone()).collect(), ring.last))
    }

    /// Receives the number of each new event.
    pub fn watch(&self) -> watch::Receiver<u64> {
        self.last.subscribe()
    }
}

/// An event as the stream has it.
pub fn framed(id: u64, name: &str, data: &str) -> String {
    format!("id: {id}\nevent: {name}\ndata: {data}\n\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_hears_what_it_missed_or_that_it_is_lost() {
        let hub = Hub::default();
        let start = hub.last();
        assert_eq!(hub.since(start), Some((vec![], start)));
        for n in 0..3 {
            hub.send("job", &n);
        }
        let (events, last) = hub.since(start + 1).unwrap();
        assert_eq!((events.len(), last), (2, start + 3));
        assert_eq!(&*events[0], format!("id: {}\nevent: job\ndata: 1\n\n", start + 2));
        assert_eq!((hub.since(start - 1), hub.since(start + 4)), (None, None));
        for n in 0..MOST_EVENTS {
            hub.send("job", &n);
        }
        assert_eq!((hub.since(start + 2), hub.since(start + 3).map(|(all, _)| all.len())), (None, Some(MOST_EVENTS)));
    }

    #[test]
    fn large_events_leave_the_ring_early() {
        let hub = Hub::default();
        let start = hub.last();
        let large = "x".repeat(MOST_BYTES / 4);
        (0..9).for_each(|_| hub.send("frames", &large));
        assert!(hub.since(start).is_none() && hub.since(start + 6).is_some());
        let kept = hub.kept_since(start);
        assert!(kept > start && hub.since(kept).is_some() && hub.since(kept - 1).is_none());
        assert_eq!(hub.kept_since(start + 99), start + 9);
        let ring = hub.ring();
        assert!(ring.bytes <= MOST_BYTES && ring.bytes == ring.events.iter().map(|(_, t)| t.len()).sum::<usize>());
    }
}
