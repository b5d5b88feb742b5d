//! The part of URScript that the simulated arm understands.

use crate::simulated::pose::{Pose, pose_trans};

/// A command in a line of script.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// `movel`: move in a straight line to a pose in the base's frame.
    Move {
        /// The target.
        target: Pose,
        /// Acceleration in metres per second squared.
        acceleration: f64,
        /// Speed in metres per second.
        speed: f64,
    },
    /// `stopl`: stop with this deceleration in metres per second squared.
    Stop(f64),
}

impl Command {
    /// Parses a line; `None` if it is not a supported command.
    pub fn parse(line: &str) -> Option<Command> {
        let mut parser = Parser { rest: line };
        let name = parser.word()?;
        let arguments = parser.arguments()?;
        if !parser.rest.trim().is_empty() {
            return None;
        }
        // Arguments are positional or named; the defaults are URScript's.
        let number = |place: usize, name: &str, default: f64| {
            let named = arguments.iter().find(|argument| argument.name == Some(name));
            match named.or(arguments.get(place).filter(|argument| argument.name.is_none())) {
                None => Some(default),
                Some(Argument { value: Value::Number(number), .. }) if *number > 0.0 => Some(*number),
                Some(_) => None,
            }
        };
        match (name, arguments.first().map(|argument| &argument.value)) {
            ("movel", Some(&Value::Pose(target))) => {
                Some(Command::Move { target, acceleration: number(1, "a", 1.2)?, speed: number(2, "v", 0.25)? })
            }
            ("stopl", Some(Value::Number(_))) => Some(Command::Stop(number(0, "a", 1.0)?)),
            _ => None,
        }
    }
}

enum Value {
    Number(f64),
    Pose(Pose),
}

struct Argument<'t> {
    name: Option<&'t str>,
    value: Value,
}

struct Parser<'t> {
    rest: &'t str,
}

impl<'t> Parser<'t> {
    fn word(&mut self) -> Option<&'t str> {
        let text = self.rest.trim_start();
        let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
        let (word, rest) = text.split_at(end);
        self.rest = rest;
        Some(word).filter(|word| word.starts_with(char::is_alphabetic))
    }

    fn takes(&mut self, symbol: char) -> Option<()> {
        self.rest = self.rest.trim_start().strip_prefix(symbol)?;
        Some(())
    }

    fn list<T>(&mut self, open: char, close: char, item: impl Fn(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        self.takes(open)?;
        let mut items = Vec::new();
        loop {
            items.push(item(self)?);
            if self.takes(close).is_some() {
                return Some(items);
            }
            self.takes(',')?;
        }
    }

    fn arguments(&mut self) -> Option<Vec<Argument<'t>>> {
        self.list('(', ')', |parser| {
            let before = parser.rest;
            let name = parser.word().filter(|_| parser.takes('=').is_some());
            if name.is_none() {
                parser.rest = before;
            }
            Some(Argument { name, value: parser.value()? })
        })
    }

    fn value(&mut self) -> Option<Value> {
        let before = self.rest;
        match self.word() {
            Some("p") => {
                let numbers = self.list('[', ']', Parser::number)?;
                Some(Value::Pose(numbers.try_into().ok()?))
            }
            Some("pose_trans") => match self.arguments()?[..] {
                [Argument { value: Value::Pose(from), .. }, Argument { value: Value::Pose(to), .. }] => {
                    Some(Value::Pose(pose_trans(from, to)))
                }
                _ => None,
            },
            Some(_) => None,
            None => {
                self.rest = before;
                self.number().map(Value::Number)
            }
        }
    }

    fn number(&mut self) -> Option<f64> {
        let text = self.rest.trim_start();
        let end = text.find([',', ')', ']']).unwrap_or(text.len());
        let (number, rest) = text.split_at(end);
        self.rest = rest;
        number.trim().parse().ok().filter(|number: &f64| number.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_parsed() {
        let target = [0.15, 0.2, 0.3, 0.0, 0.0, 0.0];
        let moving = Command::Move { target, acceleration: 0.5, speed: 0.1 };
        for line in [
            "movel(p[0.15, 0.2, 0.3, 0, 0, 0], a=0.5, v=0.1)",
            "  movel( p[0.15,0.2,0.3,0,0,0] , 0.5 , 0.1 )  ",
            "movel(p[1.5e-1, 0.2, 0.3, 0, 0, 0], v=0.1, a=0.5, t=0, r=0)",
        ] {
            assert_eq!(Command::parse(line), Some(moving.clone()), "{line}");
        }
        let relative = "movel(pose_trans(p[0.1, 0.2, 0.3, 0, 0, 0], p[0.05, 0, 0, 0, 0, 0]))";
        assert!(matches!(Command::parse(relative), Some(Command::Move { target: [x, ..], .. }) if (x - 0.15).abs() < 1e-12));
        assert_eq!(Command::parse("stopl(1.5)"), Some(Command::Stop(1.5)));
        for line in
            ["", "movel", "movel(", "movel()", "movel(p[1,2,3])", "stopl(p[0,0,0,0,0,0])", "stopl(1) x", "movej(p[0,0,0,0,0,0])"]
        {
            assert_eq!(Command::parse(line), None, "{line}");
        }
    }
}
