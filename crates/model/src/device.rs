//! Where and how a model computes.

use crate::{Error, Result};
use candle_core::Device;
use kinelm_store::Subject;
use std::fmt;
use std::str::FromStr;

/// A device by its name: `cpu` or `cuda:N`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeviceName {
    /// The processor.
    #[default]
    Cpu,
    /// The Nvidia card of this number.
    Cuda(usize),
}

/// How the model is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Form {
    /// The fastest form that the device has.
    #[default]
    Auto,
    /// The plain form, which faster ones are compared with.
    Plain,
}

/// Where and how a model computes. No file depends on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Compute {
    /// Where.
    pub device: DeviceName,
    /// How.
    pub form: Form,
}

impl Compute {
    /// Whether the engine computes: on the processor, unless the plain form is requested.
    pub fn is_fast(self) -> bool {
        self.device == DeviceName::Cpu && self.form == Form::Auto
    }
}

impl DeviceName {
    /// The device, ready to compute.
    ///
    /// # Errors
    /// A card where this program was built without CUDA, or that the driver doesn't have.
    pub fn open(self) -> Result<Device> {
        match self {
            DeviceName::Cpu => Ok(Device::Cpu),
            DeviceName::Cuda(_) if !cfg!(feature = "cuda") => Err(Error::unsupported(
                Subject::of_parameter("device").with(self),
                "this kinelm was built without CUDA; build one with scripts/cuda/build.sh, or use cpu",
            )),
            DeviceName::Cuda(n) => Device::new_cuda(n).map_err(|e| {
                let said = e.to_string(); // a backtrace may follow the first line
                let first = said.lines().next().unwrap_or_default();
                let help = "expected an Nvidia card of that number and its driver (see nvidia-smi), or cpu";
                Error::unsupported(Subject::of_parameter("device").with(self), format!("{first}; {help}"))
            }),
        }
    }
}

impl fmt::Display for DeviceName {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            DeviceName::Cpu => f.write_str("cpu"),
            DeviceName::Cuda(n) => write!(f, "cuda:{n}"),
        }
    }
}

impl FromStr for DeviceName {
    type Err = Error;

    fn from_str(text: &str) -> Result<DeviceName> {
        let card = text.strip_prefix("cuda:").and_then(|n| n.parse().ok()).map(DeviceName::Cuda);
        let named = if text == "cpu" { Some(DeviceName::Cpu) } else { card };
        named.ok_or_else(|| Error::invalid_parameter("device", text, "cpu, or cuda:N as in cuda:0"))
    }
}

impl fmt::Display for Form {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Form::Auto => "auto",
            Form::Plain => "plain",
        })
    }
}

impl FromStr for Form {
    type Err = Error;

    fn from_str(text: &str) -> Result<Form> {
        match text {
            "auto" => Ok(Form::Auto),
            "plain" => Ok(Form::Plain),
            _ => Err(Error::invalid_parameter("form", text, "auto or plain")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_back_and_others_are_refused() {
        for name in ["cpu", "cuda:0", "cuda:12"] {
            assert_eq!(name.parse::<DeviceName>().unwrap().to_string(), name);
        }
        for name in ["", "cuda", "cuda:", "cuda:-1", "gpu"] {
            let message = name.parse::<DeviceName>().unwrap_err().to_string();
            assert_eq!(message, format!("`device` is {name}; expected cpu, or cuda:N as in cuda:0"));
        }
        assert_eq!("plain".parse::<Form>().unwrap(), Form::Plain);
        assert!("fast".parse::<Form>().is_err());
    }

    #[test]
    #[cfg(not(feature = "cuda"))]
    fn a_card_without_cuda_says_what_to_build() {
        let message = DeviceName::Cuda(1).open().unwrap_err().to_string();
        assert!(message.starts_with("`device` cuda:1: ") && message.contains("scripts/cuda/build.sh"), "{message}");
    }
}
