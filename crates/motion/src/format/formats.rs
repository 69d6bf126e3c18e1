//! The formats of motion files: a row each, for reading, writing, messages, folders and help.

use super::{Axes, ReadOptions, amc, bvh, glb, json, motion_root, options};
#[cfg(feature = "amass")]
use super::{amass, array};
use crate::{Error, FaultKind, FileError, Motion, Result, Source};
use kinelm_store::{SourcePos, Subject};
use std::path::Path;
