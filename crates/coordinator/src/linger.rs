//! Closing a connection so that the last answer arrives. A client that still sends its body while
//! it is refused has bytes on their way that nobody reads; closing then makes the system answer
//! them with a reset, which throws away the refusal before the client looks at it. So only the
//! writing half is closed, and what still comes is read and dropped, up to bounds, until the client
//! closes, too.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::time::{Instant, Sleep};

/// Most bytes that are read and dropped: a client that sends more does not listen.
const BYTES_MAX: u64 = 1 << 30;
/// Longest time that is spent on it.
const TIME_MAX: Duration = Duration::from_secs(30);
/// Longest time without a byte: whoever has read the answer closes sooner.
const IDLE_MAX: Duration = Duration::from_secs(5);
/// Bytes that are dropped at once before others have their turn.
const TURN_BYTES: u64 = 1 << 20;

/// What is left of closing.
struct Closing {
    bytes: u64,
    until: Instant,
    wake: Pin<Box<Sleep>>,
}

/// A connection that ends as described above.
pub struct Lingering {
    stream: TcpStream,
    closing: Option<Closing>,
}

impl Lingering {
    /// Around an open connection.
    pub fn new(stream: TcpStream) -> Self {
        Lingering {
            stream,
            closing: None,
        }
    }
}

impl Closing {
    fn begin() -> Self {
        Closing {
            bytes: BYTES_MAX,
            until: Instant::now() + TIME_MAX,
            wake: Box::pin(tokio::time::sleep(IDLE_MAX)),
        }
    }

    /// Ready when the client has closed or a bound is reached.
    fn poll(&mut self, stream: &mut TcpStream, cx: &mut Context<'_>) -> Poll<()> {
        let mut room = [0u8; 16 << 10];
        let mut turn = TURN_BYTES;
        loop {
            let mut buffer = ReadBuf::new(&mut room);
            match Pin::new(&mut *stream).poll_read(cx, &mut buffer) {
                Poll::Ready(Ok(())) => {}
                Poll::Ready(Err(_)) => return Poll::Ready(()),
                Poll::Pending => break,
            }
            let read = buffer.filled().len() as u64;
            if read == 0 || read >= self.bytes {
                return Poll::Ready(());
            }
            self.bytes -= read;
            let idle = Instant::now() + IDLE_MAX;
            self.wake.as_mut().reset(idle.min(self.until));
            turn = turn.saturating_sub(read);
            if turn == 0 {
                cx.waker().wake_by_ref();
                break;
            }
        }
        self.wake.as_mut().poll(cx)
    }
}

impl AsyncRead for Lingering {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buffer)
    }
}

impl AsyncWrite for Lingering {
    fn poll_write(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(cx, bytes)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(cx, slices)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let this = &mut *self;
        if this.closing.is_none() {
            ready!(Pin::new(&mut this.stream).poll_shutdown(cx))?;
        }
        let closing = this.closing.get_or_insert_with(Closing::begin);
        closing.poll(&mut this.stream, cx).map(Ok)
    }
}
