//! Matches a distorted, tilted set of frames that is in flash: each line is rectified on its way to the matcher of profile
//! `qqvga`, and the disparities are sent as packets.
//!
//! The set is in the folder `MULTISCOPIC_FLASH_SET` when this is built: `center.gray`, `left.gray` and `right.gray` with a byte
//! for each pixel, and beside them `center.grid`, `left.grid` and `right.grid` with the displacements of the nodes, in the
//! order of pixels: right and down, 16 bits each, little-endian. `cargo xtask edge --profile qqvga-rectified` renders a set,
//! builds this for it, and compares the packets with the host's. With the argument `plain`, frames are matched as they are.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image {
    use core::{convert::Infallible, time::Duration};
    use embedded_io::Write;
    use multiscopic_core::{
        Displacement, DisplacementGrid, Frame, Fusion, Rectification, Rectified, RectifiedError, Rewind, ScanlineSource,
        SearchSpace, View, Views, params,
    };
    use multiscopic_edge::{Board, Matching, Phase, Workspace, profile::QQVGA, workspace};
    use multiscopic_firmware::{HostError, HostFile, Semihosted, fail};
    use semihosting::{experimental::env, process};
    use static_cell::ConstStaticCell;

    params!(Match: Matching = Ok(QQVGA.matching(Fusion::Min)));
    const WIDTH: usize = Match::PARAMS.search().width();
    const HEIGHT: usize = Match::PARAMS.search().height();

    /// A file of the set.
    macro_rules! flash {
        ($name:literal) => {
            include_bytes!(concat!(env!("MULTISCOPIC_FLASH_SET"), "/", $name))
        };
    }

    static CENTER: [u8; WIDTH * HEIGHT] = *flash!("center.gray");
    static LEFT: [u8; WIDTH * HEIGHT] = *flash!("left.gray");
    static RIGHT: [u8; WIDTH * HEIGHT] = *flash!("right.gray");

    const GRID: DisplacementGrid = DisplacementGrid::new(WIDTH as u16, HEIGHT as u16, 16).unwrap();
    type Nodes = [Displacement; GRID.nodes()];
    static CENTER_NODES: Nodes = nodes(flash!("center.grid"));
    static LEFT_NODES: Nodes = nodes(flash!("left.grid"));
    static RIGHT_NODES: Nodes = nodes(flash!("right.grid"));

    /// The views were turned a little against the centre, so each has its own displacements.
    const OWN: [(Frame, &[Displacement]); 2] = [(Frame::View(View::LEFT), &LEFT_NODES), (Frame::View(View::RIGHT), &RIGHT_NODES)];
    const RECTIFICATION: Rectification = match Rectification::new(GRID, &CENTER_NODES, &OWN) {
        Ok(rectification) => rectification,
        Err(_) => panic!("a displacement is missing"),
    };
    /// The words of the lines that rectified lines are interpolated from.
    const LINE_WORDS: usize = RECTIFICATION.memory(Views::HORIZONTAL).words();

    static WORKSPACE: ConstStaticCell<workspace!(QQVGA)> = ConstStaticCell::new(Workspace::new());
    static LINES: ConstStaticCell<[u32; LINE_WORDS]> = ConstStaticCell::new([0; LINE_WORDS]);

    const fn nodes(bytes: &[u8; size_of::<Nodes>()]) -> Nodes {
        let (mut nodes, mut k) = ([Displacement::ZERO; GRID.nodes()], 0);
        while k < nodes.len() {
            let [right, down] =
                [i16::from_le_bytes([bytes[4 * k], bytes[4 * k + 1]]), i16::from_le_bytes([bytes[4 * k + 2], bytes[4 * k + 3]])];
            nodes[k] = Displacement { right, down };
            k += 1;
        }
        nodes
    }

    /// Frames in flash.
    struct Flash;

    impl ScanlineSource for Flash {
        type Error = Infallible;

        fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
            let frame = match frame {
                Frame::Center => &CENTER,
                Frame::View(View::LEFT) => &LEFT,
                Frame::View(_) => &RIGHT,
            };
            line.copy_from_slice(&frame[v * WIDTH..][..WIDTH]);
            Ok(())
        }
    }

    impl Rewind for Flash {
        fn rewind(&mut self) -> Result<(), Infallible> {
            Ok(())
        }
    }

    /// The frames, rectified or as they are: the difference is the cost of the rectification.
    #[expect(clippy::large_enum_variant, reason = "there is one of them, and nothing allocates")]
    enum FlashFrames {
        Rectified(Rectified<'static, Flash>),
        Plain(Flash),
    }

    impl ScanlineSource for FlashFrames {
        type Error = RectifiedError<Infallible>;

        fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
            match self {
                FlashFrames::Rectified(frames) => frames.read_line(frame, v, line),
                FlashFrames::Plain(frames) => frames.read_line(frame, v, line).map_err(RectifiedError::Source),
            }
        }
    }

    impl Rewind for FlashFrames {
        fn rewind(&mut self) -> Result<(), Self::Error> {
            match self {
                FlashFrames::Rectified(frames) => frames.rewind(),
                FlashFrames::Plain(frames) => frames.rewind().map_err(RectifiedError::Source),
            }
        }
    }

    /// A board with the set in flash.
    struct FlashBoard {
        lines: Option<&'static mut [u32; LINE_WORDS]>,
    }

    impl Board for FlashBoard {
        type Frames = FlashFrames;
        type Output = HostFile;
        type Error = HostError;

        fn frames(&mut self, search: &SearchSpace) -> Result<FlashFrames, HostError> {
            Ok(match self.lines.take() {
                Some(lines) => match Rectified::new(Flash, &RECTIFICATION, search.views(), lines) {
                    Ok(frames) => FlashFrames::Rectified(frames),
                    Err(error) => fail(error),
                },
                None => FlashFrames::Plain(Flash),
            })
        }

        fn output(&mut self) -> Result<HostFile, HostError> {
            HostFile::create(multiscopic_edge::frame_file::PACKETS)
        }

        fn elapsed(&self) -> Duration {
            Semihosted.elapsed()
        }

        fn enter(phase: Phase) {
            Semihosted::enter(phase);
        }
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let mut board = FlashBoard { lines: (!is_plain()).then(|| LINES.take()) };
        let mut output = board.output().unwrap_or_else(|error| fail(error));
        let mut frames = [board.frames(Match::PARAMS.search()).unwrap_or_else(|error| fail(error))];
        let run = WORKSPACE.take().pipeline().run::<FlashBoard, _>(&Match, &mut frames, &mut output);
        let mut sender = run.unwrap_or_else(|error| fail(error));
        let stack = multiscopic_firmware::stack_depth();
        let end = sender.end(Some(stack)).unwrap_or_else(|error| fail(error));
        output.write_all(end).unwrap_or_else(|error| fail(error));
        process::exit(0)
    }

    /// True if frames are to be matched as they are.
    ///
    /// Not inlined, so that the command line leaves the stack before matching begins.
    #[inline(never)]
    fn is_plain() -> bool {
        let words = env::args::<128>();
        words.is_ok_and(|words| (&words).into_iter().any(|word| word == Ok("plain")))
    }
}

#[cfg(not(target_os = "none"))]
fn main() {}
