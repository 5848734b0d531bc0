//! The identifier's loop: one session, or several in turn.

use super::session::{Session, Turn};
use super::{RunError, Shutdown, Stay, TICK};
use crate::bus::BusError;
use std::time::{Duration, Instant};

/// How long the samples that arrived before the request to stop may take: with a plant faster than
/// this process they would never end.
const LAST_LOOK: Duration = Duration::from_millis(200);
/// Pause between two rounds over many sessions. An event per sample and robot would cost more than
/// it saves: at 1 kHz each round finds a sample of almost every robot.
const ROUND: Duration = Duration::from_micros(500);

/// Turns samples into estimates until asked to stop, or to the end of the first stream of each
/// session. A last status follows the last estimate, after everything that was received has been
/// processed. A failure in one of several sessions ends only that one. `turned` is called once per
/// [`TICK`].
///
/// # Errors
/// If the bus fails: for a single session at once, for one of several after all have ended.
pub fn run_sessions(
    sessions: &mut [Session],
    stay: Stay,
    shutdown: &Shutdown,
    turned: &dyn Fn(),
) -> Result<(), RunError> {
    let alone = sessions.len() == 1;
    let mut failed = None;
    let mut asked: Option<Instant> = None;
    let mut more = false;
    let mut tick_due = Instant::now();
    loop {
        match &mut sessions[..] {
            _ if more => {}
            [session] => {
                session.look()?;
                session.wait(TICK)?;
            }
            _ => std::thread::sleep(ROUND),
        }
        let tick = Instant::now() >= tick_due;
        if tick {
            tick_due = Instant::now() + TICK;
            turned();
        }
        let look = tick && !alone;
        // Checked before the last read of the queue: samples that arrived before the request are
        // processed, as far as time permits.
        let stopping = shutdown.requested();
        let late = stopping && asked.get_or_insert_with(Instant::now).elapsed() >= LAST_LOOK;
        more = false;
        for session in sessions.iter_mut().filter(|session| !session.is_done()) {
            let _named = (!alone).then(|| session.span().entered());
            match round(session, look, stopping, late, stay) {
                Ok(left) => more |= left,
                Err(e) if alone => return Err(e.into()),
                Err(e) => {
                    tracing::error!("{e}");
                    session.give_up();
                    failed = Some(e);
                }
            }
        }
        if sessions.iter().all(Session::is_done) {
            break;
        }
    }
    linger(sessions, shutdown)?;
    failed.map_or(Ok(()), |e| Err(e.into()))
}

/// One turn of a session; true if more samples wait.
fn round(session: &mut Session, look: bool, stopping: bool, late: bool, stay: Stay) -> Result<bool, BusError> {
    let turn = session.turn()?;
    if turn == Turn::More && !late {
        return Ok(true);
    }
    if session.is_over(stopping, stay) {
        session.finish()?;
    } else if look {
        session.look()?;
    }
    Ok(false)
}

/// Keeps the last messages readable until readers have received them.
fn linger(sessions: &mut [Session], shutdown: &Shutdown) -> Result<(), RunError> {
    let start = Instant::now();
    loop {
        let mut staying = false;
        for session in sessions.iter_mut() {
            staying |= !session.linger(start.elapsed(), shutdown.requested())?;
        }
        if !staying {
            return Ok(());
        }
        std::thread::sleep(TICK / 10);
    }
}
