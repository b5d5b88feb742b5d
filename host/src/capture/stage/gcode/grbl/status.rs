//! Status reports, error codes and alarm codes of Grbl.

use crate::capture::stage::gcode::line_port::parse_coordinate;

/// Returns true if this line says that Grbl has started.
pub fn is_banner(line: &str) -> bool {
    line.get(..4).is_some_and(|start| start.eq_ignore_ascii_case("grbl")) && line.contains("'$'")
}

/// A status report.
#[derive(Clone, Debug, PartialEq)]
pub struct Status {
    /// The machine's state, such as `Idle` or `Hold:0`.
    pub state: String,
    /// Machine coordinates in millimetres.
    pub coordinates: [f64; 2],
}

/// Parses status reports. Grbl reports work coordinates if it is configured to, and their offset only now and
/// then.
#[derive(Clone, Debug)]
pub struct StatusParser {
    /// The unit of reported coordinates, in millimetres.
    unit_mm: f64,
    /// From work to machine coordinates, in that unit.
    work_offset: Option<[f64; 2]>,
}

impl StatusParser {
    /// For reports in units of `unit_mm` millimetres.
    pub fn new(unit_mm: f64) -> StatusParser {
        StatusParser { unit_mm, work_offset: None }
    }

    /// Parses a report. `None` if it does not tell the machine coordinates.
    pub fn parse(&mut self, report: &str) -> Option<Status> {
        // A number in a report that broke off may lack digits.
        let mut fields = report.strip_prefix('<')?.strip_suffix('>')?.split('|');
        let state = fields.next()?.to_owned();
        let (mut machine, mut work) = (None, None);
        for (name, value) in fields.filter_map(|field| field.split_once(':')) {
            let mut numbers = value.split(',').map(parse_coordinate);
            let mut xy = || Some([numbers.next()??, numbers.next()??]);
            match name {
                "MPos" => machine = xy(),
                "WPos" => work = xy(),
                "WCO" => self.work_offset = xy(),
                _ => {}
            }
        }
        let from_work = || Some([work?[0] + self.work_offset?[0], work?[1] + self.work_offset?[1]]);
        let coordinates = machine.or_else(from_work)?.map(|number| number * self.unit_mm);
        Some(Status { state, coordinates })
    }
}

/// Describes an error code. Only those that a move can cause are explained.
pub fn describe_error(code: &str) -> String {
    let meaning = match code {
        "8" | "9" => "it is locked: home or unlock it",
        "13" => "its safety door is open",
        "15" | "33" => "the target is out of the machine's travel",
        "20" | "29" => "it does not know this G-code",
        _ => "see its manual",
    };
    format!("error {code}, {meaning}")
}

/// Describes an alarm code.
pub fn describe_alarm(code: &str) -> String {
    let meaning = match code {
        "1" => "a limit switch was hit",
        "2" => "the target is out of the machine's travel",
        "3" => "it was reset while it moved",
        "6" | "7" | "8" | "9" => "homing failed",
        _ => "see its manual",
    };
    format!("alarm {code}, {meaning}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_in_machine_and_work_coordinates() {
        let mut parser = StatusParser::new(1.0);
        let coordinates =
            |parser: &mut StatusParser, report: &str| parser.parse(&format!("<{report}>")).map(|status| status.coordinates);
        assert_eq!(coordinates(&mut parser, "Idle|MPos:1.000,-2.500,0.000|FS:0,0"), Some([1.0, -2.5]));
        // Work coordinates need their offset, which is remembered.
        assert_eq!(coordinates(&mut parser, "Idle|WPos:1.000,2.000,0.000|FS:0,0"), None);
        assert_eq!(coordinates(&mut parser, "Hold:0|WPos:1.000,2.000,0.000|WCO:10.000,20.000,0.000"), Some([11.0, 22.0]));
        assert_eq!(coordinates(&mut parser, "Run|WPos:2.000,2.000,0.000|Ov:100,100,100"), Some([12.0, 22.0]));
        let mut inches = StatusParser::new(25.4);
        assert_eq!(coordinates(&mut inches, "Idle|MPos:1.000,0.500,0.000"), Some([25.4, 12.7]));
        for report in ["", "Idle", "Idle|MPos:", "Idle|MPos:1", "Idle|MPos:1,x", "Idle|MPos:nan,0", "Idle|MPos:1e9,0", "|:|,:"] {
            assert_eq!(coordinates(&mut inches, report), None, "{report}");
        }
    }

    #[test]
    fn a_report_that_breaks_off_tells_nothing() {
        let report = "<Idle|WPos:1.000,2.000,0.000|FS:0,0|WCO:10.000,20.000,0.000>";
        let mut parser = StatusParser::new(1.0);
        assert!((0..report.len()).all(|length| parser.parse(&report[..length]).is_none()));
        // Not even the offset.
        assert_eq!(parser.parse("<Idle|WPos:1.000,2.000,0.000>"), None);
        assert!(parser.parse(report).is_some());
    }

    #[test]
    fn banners() {
        let banners = [
            "Grbl 1.1h ['$' for help]",
            "GrblHAL 1.1f ['$' or '$HELP' for help]",
            "Grbl 3.7 [FluidNC v3.7.8 (wifi) '$' for help]",
        ];
        assert_eq!(banners.map(is_banner), [true; 3]);
        assert_eq!(["grb", "[VER:1.1h.20190825:]", "éé", "ok"].map(is_banner), [false; 4]);
    }
}
