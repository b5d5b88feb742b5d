//! The buffers of a stream: the driver's memory, which it fills with frames.

#![expect(unsafe_code, reason = "drivers share their memory, and fill in structures of C")]

use std::{
    io, mem, ptr, slice,
    sync::Arc,
    time::{Duration, Instant},
};

use v4l::{
    Device,
    buffer::{Flags, Type},
    memory::Memory,
    v4l_sys::{timeval, v4l2_buffer, v4l2_plane, v4l2_requestbuffers},
    v4l2::{self, vidioc},
};

use super::ioctl::{self, MAX_PLANES};

/// Buffers in memory that the driver shares. Dropping them gives them back.
pub(super) struct Buffers {
    device: Arc<Device>,
    kind: Type,
    /// The planes of each buffer.
    mapped: Vec<Vec<Mapping>>,
    /// The buffer that is read, and not the driver's.
    held: Option<u32>,
}

/// A frame in a buffer.
pub(super) struct Frame<'a> {
    /// The bytes of each plane.
    pub planes: Vec<&'a [u8]>,
    /// True if the driver has marked it as damaged.
    pub is_damaged: bool,
    /// The time at which the driver took it; without a stamp to be believed, that at which it was read.
    pub at: Instant,
}

impl Buffers {
    /// Has the driver allocate buffers of its format: as many as it can, at most `count`.
    pub(super) fn allocate(device: Arc<Device>, kind: Type, count: u32) -> io::Result<Buffers> {
        let mut buffers = Buffers { device, kind, mapped: Vec::new(), held: None };
        for index in 0..buffers.request(count)? {
            let (_, planes) = buffers.call(vidioc::VIDIOC_QUERYBUF, index)?;
            let planes = planes.iter().map(|plane| Mapping::of(&buffers.device, plane));
            buffers.mapped.push(planes.collect::<io::Result<_>>()?);
        }
        Ok(buffers)
    }

    /// The number of buffers.
    pub(super) fn count(&self) -> u32 {
        self.mapped.len() as u32
    }

    /// Gives a buffer to the driver.
    pub(super) fn queue(&mut self, index: u32) -> io::Result<()> {
        self.call(vidioc::VIDIOC_QBUF, index).map(drop)
    }

    /// Starts the stream.
    pub(super) fn start(&mut self) -> io::Result<()> {
        self.switch(vidioc::VIDIOC_STREAMON)
    }

    /// Stops the stream. The driver has no buffers then.
    pub(super) fn stop(&mut self) -> io::Result<()> {
        self.switch(vidioc::VIDIOC_STREAMOFF)
    }

    /// Waits until a frame, or an error to be read, is ready. Returns false if none is within so many milliseconds.
    pub(super) fn poll(&self, milliseconds: i32) -> io::Result<bool> {
        Ok(self.device.handle().poll(libc::POLLIN, milliseconds)? > 0)
    }

    /// Gives the last frame's buffer back, and reads the next frame, which must be ready.
    pub(super) fn next(&mut self) -> io::Result<Frame<'_>> {
        if let Some(index) = self.held.take() {
            self.queue(index)?;
        }
        let (buffer, planes) = self.call(vidioc::VIDIOC_DQBUF, 0)?;
        let Some(mapped) = self.mapped.get(buffer.index as usize) else {
            return Err(io::Error::other(format!("the driver names buffer {} of {}", buffer.index, self.count())));
        };
        self.held = Some(buffer.index);
        Ok(Frame {
            planes: mapped.iter().zip(planes).map(|(mapping, plane)| mapping.used(&plane)).collect(),
            is_damaged: Flags::from(buffer.flags).contains(Flags::ERROR),
            at: moment(Flags::from(buffer.flags), buffer.timestamp),
        })
    }

    /// Requests buffers, and returns how many the driver has allocated.
    fn request(&self, count: u32) -> io::Result<u32> {
        // SAFETY: the call takes and fills in this structure, for which zeros are valid.
        unsafe {
            let asked = v4l2_requestbuffers { count, type_: self.kind as u32, memory: Memory::Mmap as u32, ..mem::zeroed() };
            ioctl::call(&self.device, vidioc::VIDIOC_REQBUFS, asked).map(|granted| granted.count)
        }
    }

    fn switch(&self, number: vidioc::_IOC_TYPE) -> io::Result<()> {
        // SAFETY: both calls take the type of the buffers.
        unsafe { ioctl::call(&self.device, number, self.kind as u32).map(drop) }
    }

    /// Calls the driver about a buffer. Returns its answer, and the planes of the buffer.
    fn call(&self, number: vidioc::_IOC_TYPE, index: u32) -> io::Result<(v4l2_buffer, Vec<v4l2_plane>)> {
        let is_multi_planar = matches!(self.kind, Type::VideoCaptureMplane);
        // SAFETY: the three calls take and fill in this structure, for which zeros are valid. Of the multi-planar interface, it
        // points to as many planes as it says; otherwise the offset in it is that of the only one.
        unsafe {
            let mut planes: [v4l2_plane; MAX_PLANES] = mem::zeroed();
            let mut asked = v4l2_buffer { index, type_: self.kind as u32, memory: Memory::Mmap as u32, ..mem::zeroed() };
            if is_multi_planar {
                asked.m.planes = planes.as_mut_ptr();
                asked.length = MAX_PLANES as u32;
            }
            let found = ioctl::call(&self.device, number, asked)?;
            if !is_multi_planar {
                planes[0].bytesused = found.bytesused;
                planes[0].length = found.length;
                planes[0].m.mem_offset = found.m.offset;
            }
            let count = if is_multi_planar { found.length as usize } else { 1 };
            Ok((found, planes[..count.min(MAX_PLANES)].to_vec()))
        }
    }
}

impl Drop for Buffers {
    fn drop(&mut self) {
        // A driver frees no buffer that is mapped. Nor can it be told anything if it is gone.
        self.mapped.clear();
        let _ = self.request(0);
    }
}

/// A plane of a buffer, mapped into memory to be read.
struct Mapping {
    start: *mut u8,
    length: usize,
}

// SAFETY: the memory belongs to the process, whichever thread reads it.
unsafe impl Send for Mapping {}

impl Mapping {
    fn of(device: &Device, plane: &v4l2_plane) -> io::Result<Mapping> {
        let length = plane.length as usize;
        // SAFETY: a new mapping of memory that the driver has allocated for this plane, at the offset that it has told.
        let start = unsafe {
            let offset = plane.m.mem_offset.into();
            v4l2::mmap(ptr::null_mut(), length, libc::PROT_READ, libc::MAP_SHARED, device.handle().fd(), offset)?
        };
        Ok(Mapping { start: start.cast(), length })
    }

    /// The bytes that the driver says it has filled: the buffer may be longer than the frame.
    fn used(&self, plane: &v4l2_plane) -> &[u8] {
        // SAFETY: the memory is mapped as long as this lives, and holds any bytes. The buffer is not the driver's to fill while
        // its frame is borrowed.
        let bytes = unsafe { slice::from_raw_parts(self.start, self.length) };
        let end = self.length.min(plane.bytesused as usize);
        bytes.get(plane.data_offset as usize..end).unwrap_or_default()
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: the memory was mapped with this length, and nothing borrows it any more.
        let _ = unsafe { v4l2::munmap(self.start.cast(), self.length) };
    }
}

/// The moment of a frame by the driver's stamp; now if it is of another clock than that of [`Instant`], not of the past second.
fn moment(flags: Flags, stamp: timeval) -> Instant {
    const BELIEVED: Duration = Duration::from_secs(1);
    let now = Instant::now();
    // SAFETY: the call fills in this structure, for which zeros are valid.
    let clock = unsafe {
        let mut clock: libc::timespec = mem::zeroed();
        libc::clock_gettime(libc::CLOCK_MONOTONIC, &raw mut clock);
        Duration::new(clock.tv_sec.unsigned_abs(), clock.tv_nsec as u32)
    };
    let stamp = Duration::new(stamp.tv_sec.unsigned_abs(), 1000 * stamp.tv_usec as u32);
    let age = clock.checked_sub(stamp).filter(|&age| flags.contains(Flags::TIMESTAMP_MONOTONIC) && age < BELIEVED);
    age.and_then(|age| now.checked_sub(age)).unwrap_or(now)
}
