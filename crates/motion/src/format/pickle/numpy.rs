//! The calls with which numpy rebuilds pickled arrays.

use super::machine::Machine;
use super::{ArrayParts, Id, Object, Stop};
use crate::error::FaultKind;
use crate::format::array::{Dtype, Element, Order, byte_count, tuple};
use std::borrow::Cow;

type Step<T = ()> = Result<T, Stop>;

impl<'a> Machine<'a> {
    fn object(&self, id: Id) -> &Object<'a> {
        &self.values[id as usize]
    }

    fn tuple(&self, id: Id) -> Step<Vec<Id>> {
        match self.object(id) {
            // calls have few arguments and arrays few axes
            Object::Tuple(items) if items.len() <= 64 => Ok(items.clone()),
            _ => Err(self.bad("arguments that are no tuple".into(), "a tuple")),
        }
    }

    /// REDUCE: calls a name with arguments.
    pub(super) fn reduce(&mut self) -> Step {
        let (arguments, callee) = (self.pop()?, self.pop()?);
        let Object::Global(name) = *self.object(callee) else {
            return Err(self.refuse("a call of what is no name".into()));
        };
        let arguments = self.tuple(arguments)?;
        let value = match (name, arguments.as_slice()) {
            ("_reconstruct", &[class, _, _]) if matches!(self.object(class), Object::Global("ndarray")) => {
                Object::Array(ArrayParts::Blank)
            }
            ("dtype", &[descr, ..]) => Object::Dtype(self.dtype(descr)?),
            ("scalar", &[dtype, bytes]) => self.array(dtype, vec![], Order::C, bytes)?,
            ("_frombuffer", &[bytes, dtype, shape, order]) => {
                let (shape, order) = (self.shape(shape)?, self.order(order, None)?);
                self.array(dtype, shape, order, bytes)?
            }
            ("_frombuffer", &[bytes, dtype, shape, order, axes]) => {
                let (shape, order) = (self.shape(shape)?, self.order(order, Some(axes))?);
                let shape = match &order {
                    // the shape is that of the memory order
                    Order::Axes(axes) => self.permuted(&shape, axes)?,
                    _ => shape,
                };
                self.array(dtype, shape, order, bytes)?
            }
            ("encode", &[text, coding]) => self.latin1(text, coding)?,
            _ => return Err(self.refuse(format!("a call of {name} with {} arguments", arguments.len()))),
        };
        self.push(value)
    }

    /// BUILD: sets the state of an array or a type.
    pub(super) fn build(&mut self) -> Step {
        let state = self.pop()?;
        let target = self.peek()?;
        let built = match self.object(target) {
            Object::Dtype(dtype) => {
                let dtype = *dtype;
                Object::Dtype(self.dtype_state(dtype, state)?)
            }
            Object::Array(ArrayParts::Blank) => match *self.tuple(state)?.as_slice() {
                // version, shape, type, Fortran order, elements; files before numpy 1.0 have no version
                [_, shape, dtype, fortran, elements] | [shape, dtype, fortran, elements] => {
                    let order = match self.object(fortran) {
                        Object::Bool(true) | Object::Int(1) => Order::Fortran,
                        _ => Order::C,
                    };
                    let shape = self.shape(shape)?;
                    self.array(dtype, shape, order, elements)?
                }
                _ => return Err(self.bad("an array's state of another length".into(), "a tuple of 5")),
            },
            _ => return Err(self.refuse("a state for what is no array".into())),
        };
        // in place: the memo refers to it, and later references must see the finished array
        self.values[target as usize] = built;
        Ok(())
    }

    fn array(&self, dtype: Id, shape: Vec<usize>, order: Order, elements: Id) -> Step<Object<'a>> {
        let Object::Dtype(dtype) = *self.object(dtype) else {
            return Err(self.bad("an array without a type".into(), "a numpy dtype"));
        };
        let found = match self.object(elements) {
            Object::List(items) if dtype.element == Element::Object => {
                if shape.iter().try_fold(1usize, |p, &n| p.checked_mul(n)) == Some(items.len()) {
                    return Ok(Object::Array(ArrayParts::Objects { list: elements }));
                }
                format!("{} objects", items.len())
            }
            Object::Bytes(bytes) if dtype.element != Element::Object => {
                if byte_count(&shape, &dtype) == Some(bytes.len() as u64) {
                    return Ok(Object::Array(ArrayParts::Plain { dtype, shape, order, bytes: elements }));
                }
                format!("{} bytes", bytes.len())
            }
            _ => "elements of another kind".into(),
        };
        let shape = tuple(&shape);
        Err(self.bad(format!("{found} for an array of {dtype} and shape {shape}"), "as many as the shape says"))
    }

    /// `dtype('f8', ..)`.
    fn dtype(&self, descr: Id) -> Step<Dtype> {
        let text: Cow<str> = match self.object(descr) {
            Object::Text(t) => t.as_ref().into(),
            Object::Bytes(b) => String::from_utf8_lossy(b),
            _ => return Err(self.bad("a type without a name".into(), "text")),
        };
        Dtype::parse(&text).ok_or_else(|| self.no_type(&text))
    }

    /// A type's state: version, byte order, then subarray, names and fields, which plain types lack.
    fn dtype_state(&self, dtype: Dtype, state: Id) -> Step<Dtype> {
        let items = self.tuple(state)?;
        let &[_, order, subarray, names, fields, ..] = items.as_slice() else {
            return Err(self.bad("a type's state of another length".into(), "a tuple of 8"));
        };
        if [subarray, names, fields].iter().any(|&id| !matches!(self.object(id), Object::None)) {
            return Err(self.no_type("a record"));
        }
        let order = match self.object(order) {
            Object::Text(t) => t.as_bytes(),
            Object::Bytes(b) => b,
            _ => b"",
        };
        match order {
            b">" => Ok(Dtype { big: true, ..dtype }),
            b"<" | b"|" | b"=" => Ok(Dtype { big: false, ..dtype }),
            _ => Err(self.bad("an unknown byte order".into(), "one of < > | =")),
        }
    }

    fn no_type(&self, name: &str) -> Stop {
        let name: String = name.chars().take(40).collect();
        Stop { kind: FaultKind::Dtype, ..self.bad(format!("elements of type {name}"), "numbers or text") }
    }

    fn shape(&self, shape: Id) -> Step<Vec<usize>> {
        let axes = if let Object::Int(_) = self.object(shape) { vec![shape] } else { self.tuple(shape)? };
        let length = |&id: &Id| match *self.object(id) {
            Object::Int(n) => usize::try_from(n).ok(),
            _ => None,
        };
        axes.iter().map(length).collect::<Option<_>>().ok_or_else(|| self.bad("an odd shape".into(), "whole lengths"))
    }

    fn order(&self, order: Id, axes: Option<Id>) -> Step<Order> {
        let Object::Text(order) = self.object(order) else {
            return Err(self.bad("an order that is no text".into(), "C, F or K"));
        };
        match (order.as_ref(), axes) {
            ("C" | "A", _) => Ok(Order::C),
            ("F", _) => Ok(Order::Fortran),
            ("K", Some(axes)) => Ok(Order::Axes(self.shape(axes)?)),
            _ => Err(self.bad("an unknown order".into(), "C, F or K")),
        }
    }

    /// The array's shape from the shape in memory order.
    fn permuted(&self, memory: &[usize], axes: &[usize]) -> Step<Vec<usize>> {
        let shape: Option<Vec<usize>> = axes.iter().map(|&a| memory.get(a).copied()).collect();
        shape
            .filter(|s| s.len() == memory.len())
            .ok_or_else(|| self.bad("an odd order of axes".into(), "each axis once"))
    }

    /// `_codecs.encode(text, 'latin1')`, with which protocols 0 to 2 store bytes.
    fn latin1(&mut self, text: Id, coding: Id) -> Step<Object<'a>> {
        let (Object::Text(text), Object::Text(coding)) = (self.object(text), self.object(coding)) else {
            return Err(self.bad("an encoding of what is no text".into(), "text"));
        };
        if !matches!(coding.as_ref(), "latin1" | "latin-1" | "iso-8859-1") {
            return Err(self.refuse("an encoding other than latin1".into()));
        }
        let length = text.len();
        // subtracted from the budget first, because one text may be encoded repeatedly
        let text = text.clone();
        self.pay(length)?;
        let bytes: Option<Vec<u8>> = text.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect();
        match bytes {
            Some(bytes) => Ok(Object::Bytes(bytes.into())),
            None => Err(self.bad("text beyond Latin-1 for bytes".into(), "characters up to U+00FF")),
        }
    }
}
