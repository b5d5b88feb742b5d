//! The parameters as C states them, and what they stand for.

use multiscopic_core::{
    BlockMatchingParams, Census, Frame, Fusion, PathPenalties, Region, SearchConfig, SearchSpace, SemiGlobalCost,
    SemiGlobalParams, View, Views,
};

use crate::status::Status;

/// `multiscopic_view`: an offset from the centre in baselines; (0, 0) is the centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct CView {
    /// To the right.
    pub right: i8,
    /// Down.
    pub down: i8,
}

impl CView {
    /// That of a frame.
    pub fn of(frame: Frame) -> CView {
        match frame {
            Frame::Center => CView { right: 0, down: 0 },
            Frame::View(view) => CView { right: view.right(), down: view.down() },
        }
    }
}

/// `multiscopic_params`: a search, and the parameters of the method. The header says what each field is.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
#[allow(missing_docs, reason = "the header has them")]
pub struct CParams {
    pub width: u16,
    pub height: u16,
    pub min_disparity: i16,
    pub num_disparities: u16,
    pub views: [CView; 8],
    pub num_views: u8,
    pub fusion: u8,
    pub block_size: u8,
    pub uniqueness_ratio: u8,
    pub census: u8,
    pub p1: u8,
    pub p2: u8,
    pub p2_edge: u8,
}

// As the header asserts.
const _: () = assert!(size_of::<CParams>() == 32 && size_of::<CRegion>() == 8);

/// `multiscopic_region`: columns and rows of the frame.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
#[allow(missing_docs, reason = "the header has them")]
pub struct CRegion {
    pub left: u16,
    pub top: u16,
    pub width: u16,
    pub height: u16,
}

impl CParams {
    fn search(&self) -> Result<SearchSpace, Status> {
        let &CParams { width, height, min_disparity, num_disparities, .. } = self;
        let given = self.views.get(..self.num_views.into()).ok_or(Status::TooManyViews)?;
        let mut views = Views::NONE;
        for offset in given {
            let view = View::new(offset.right, offset.down).map_err(|_| Status::InvalidView)?;
            if views.contains(view) {
                return Err(Status::InvalidView);
            }
            views = views.with(view);
        }
        let fusion = *Fusion::ALL.get(usize::from(self.fusion)).ok_or(Status::InvalidFusion)?;
        Ok(SearchConfig { width, height, views, fusion, min_disparity, num_disparities }.checked()?)
    }

    fn uniqueness_ratio(&self) -> Option<u8> {
        Some(self.uniqueness_ratio).filter(|percent| *percent > 0)
    }

    /// The parameters of block matching.
    pub fn blocks(&self) -> Result<BlockMatchingParams, Status> {
        if self.census != 0 {
            return Err(Status::InvalidCensus);
        }
        let params = BlockMatchingParams::block_matching(self.search()?, self.block_size)?;
        Ok(params.with_uniqueness_ratio(self.uniqueness_ratio()))
    }

    /// The parameters of semi-global matching.
    pub fn paths(&self) -> Result<SemiGlobalParams, Status> {
        let search = self.search()?;
        let cost = match usize::from(self.census).checked_sub(1) {
            None => SemiGlobalCost::Sad { block_size: self.block_size },
            Some(window) => SemiGlobalCost::Census(*Census::ALL.get(window).ok_or(Status::InvalidCensus)?),
        };
        let penalties = match self.p2 {
            0 => cost.default_penalties(search.views().len()),
            p2 => PathPenalties::new(self.p1, p2, Some(self.p2_edge).filter(|edge| *edge > 0))?,
        };
        let params = SemiGlobalParams::with_penalties(search, cost, penalties)?;
        Ok(params.with_uniqueness_ratio(self.uniqueness_ratio()))
    }
}

impl CRegion {
    /// The region of the frame of `search`; all of it where there is no rectangle.
    pub fn region(this: Option<&CRegion>, search: &SearchSpace) -> Result<Region, Status> {
        let Some(&CRegion { left, top, width, height }) = this else { return Ok(Region::whole(search)) };
        let [left, top, width, height] = [left, top, width, height].map(usize::from);
        Ok(Region::new(search, left..left + width, top..top + height)?)
    }
}
