//! A rectangular grid of pixels of any type.

/// A grid of `width` x `height` pixels of type `T`, stored row by row from the top. It is never empty.
///
/// Make one from pixels by [`new`](Raster::new), or of one value by [`filled`](Raster::filled). Read it by pixel
/// ([`get`](Raster::get)), by row ([`row`](Raster::row), [`rows`](Raster::rows)) or as a whole ([`pixels`](Raster::pixels)).
///
/// ```
/// use multiscopic_engine::Raster;
///
/// let raster = Raster::new(3, 2, vec![1, 2, 3, 4, 5, 6]);
/// assert_eq!((raster.width(), raster.height(), raster.get(2, 1)), (3, 2, 6));
/// assert_eq!(raster.map(|p| p * 2).row(0), [2, 4, 6]);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Raster<T> {
    width: usize,
    pixels: Vec<T>,
}

/// A raster of floating-point numbers, such as disparities in pixels or depths in metres. +inf marks a pixel
/// without a value.
pub type FloatImage = Raster<f32>;

impl<T> Raster<T> {
    /// A raster of `pixels`, given row by row from the top.
    ///
    /// # Panics
    /// If a side is 0, or the number of pixels is not `width * height`.
    pub fn new(width: usize, height: usize, pixels: Vec<T>) -> Raster<T> {
        assert!(width > 0 && height > 0, "a raster of {width}x{height} pixels is empty");
        assert_eq!(pixels.len(), width * height, "the number of pixels of a {width}x{height} raster");
        Raster { width, pixels }
    }

    /// The number of pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The number of rows.
    pub fn height(&self) -> usize {
        self.pixels.len() / self.width
    }

    /// All pixels, row by row from the top.
    pub fn pixels(&self) -> &[T] {
        &self.pixels
    }

    /// All pixels, mutably, row by row from the top.
    pub fn pixels_mut(&mut self) -> &mut [T] {
        &mut self.pixels
    }

    /// Converts the raster to its pixels, row by row from the top.
    pub fn into_pixels(self) -> Vec<T> {
        self.pixels
    }

    /// The rows from the top, each [`width`](Raster::width) long.
    pub fn rows(&self) -> std::slice::ChunksExact<'_, T> {
        self.pixels.chunks_exact(self.width)
    }

    /// The rows from the top, mutably, each [`width`](Raster::width) long.
    pub fn rows_mut(&mut self) -> std::slice::ChunksExactMut<'_, T> {
        self.pixels.chunks_exact_mut(self.width)
    }

    /// Row `v`.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row(&self, v: usize) -> &[T] {
        &self.pixels[v * self.width..][..self.width]
    }

    /// Row `v`, mutably.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row_mut(&mut self, v: usize) -> &mut [T] {
        &mut self.pixels[v * self.width..][..self.width]
    }

    /// Applies `f` to every pixel and returns the results as a raster of the same size.
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Raster<U> {
        Raster { width: self.width, pixels: self.pixels.iter().map(f).collect() }
    }
}

impl<T: Copy> Raster<T> {
    /// A raster with the same value in every pixel.
    ///
    /// # Panics
    /// If a side is 0.
    pub fn filled(width: usize, height: usize, pixel: T) -> Raster<T> {
        Raster::new(width, height, vec![pixel; width * height])
    }

    /// The pixel in column `u` of row `v`.
    ///
    /// # Panics
    /// If it lies outside the raster.
    pub fn get(&self, u: usize, v: usize) -> T {
        self.row(v)[u]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_follow_each_other() {
        let mut raster = Raster::new(3, 2, vec![1, 2, 3, 4, 5, 6]);
        assert_eq!((raster.width(), raster.height()), (3, 2));
        assert_eq!(raster.row(1), [4, 5, 6]);
        assert_eq!(raster.get(2, 0), 3);
        assert!(raster.rows().eq([[1, 2, 3], [4, 5, 6]]));
        raster.row_mut(0)[1] = 7;
        raster.rows_mut().for_each(|row| row.reverse());
        assert_eq!(raster.map(|p| p * 2).into_pixels(), [6, 14, 2, 12, 10, 8]);
    }

    #[test]
    #[should_panic = "a raster of 0x4 pixels is empty"]
    fn is_never_empty() {
        Raster::filled(0, 4, 0);
    }
}
