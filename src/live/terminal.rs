//! The terminal: taken over, and restored however the program ends.

use super::table::{TableContext, draw};
use super::view::View;
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{Event, KeyCode, KeyEventKind, KeyModifiers, poll, read};
use ratatui::crossterm::terminal::size;
use std::io::{self, IsTerminal};
use std::time::Duration;

/// A key with a function.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// End the program.
    Quit,
    /// Stop the identifier.
    Pause,
    /// Resume the identifier.
    Resume,
    /// The window or the scroll position has changed: draw again.
    Redraw,
}

/// A terminal that shows the table; its previous content is restored on drop and after a panic.
#[derive(Debug)]
pub struct Screen {
    terminal: DefaultTerminal,
    scroll: usize,
    most: usize,
    colours: bool,
}

impl Screen {
    /// True if standard output is a terminal that can be drawn on.
    pub fn is_possible() -> bool {
        let dumb = std::env::var_os("TERM").is_none_or(|term| term.is_empty() || term == "dumb");
        io::stdout().is_terminal() && io::stdin().is_terminal() && !dumb
    }

    /// Takes the terminal over.
    ///
    /// # Errors
    /// If it is not a terminal, or has been closed.
    pub fn open() -> io::Result<Self> {
        let colours = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
        Ok(Self {
            terminal: ratatui::try_init()?,
            scroll: 0,
            most: 0,
            colours,
        })
    }

    /// Draws a view.
    ///
    /// # Errors
    /// If the terminal has been closed.
    pub fn draw(&mut self, view: &View, about: TableContext<'_>) -> io::Result<()> {
        let about = TableContext {
            scroll: self.scroll,
            colours: self.colours,
            ..about
        };
        let most = &mut self.most;
        self.terminal.draw(|frame| *most = draw(frame, view, &about))?;
        self.scroll = self.scroll.min(self.most);
        Ok(())
    }

    /// The next key pressed, without waiting.
    ///
    /// # Errors
    /// If the terminal has been closed.
    pub fn key(&mut self) -> io::Result<Option<Key>> {
        while poll(Duration::ZERO)? {
            let event = read()?;
            let Event::Key(key) = event else {
                match event {
                    Event::Resize(..) => return Ok(Some(Key::Redraw)),
                    _ => continue,
                }
            };
            if key.kind == KeyEventKind::Release {
                continue;
            }
            // In raw mode Ctrl-C is an ordinary key.
            let control = key.modifiers.contains(KeyModifiers::CONTROL);
            let page = 10;
            let scroll = match key.code {
                KeyCode::Char('c' | 'd') if control => return Ok(Some(Key::Quit)),
                KeyCode::Char('q') | KeyCode::Esc => return Ok(Some(Key::Quit)),
                KeyCode::Char('p') => return Ok(Some(Key::Pause)),
                KeyCode::Char('r') => return Ok(Some(Key::Resume)),
                KeyCode::Down | KeyCode::Char('j') => self.scroll.saturating_add(1),
                KeyCode::Up | KeyCode::Char('k') => self.scroll.saturating_sub(1),
                KeyCode::PageDown => self.scroll.saturating_add(page),
                KeyCode::PageUp => self.scroll.saturating_sub(page),
                KeyCode::Home => 0,
                KeyCode::End => self.most,
                _ => continue,
            };
            self.scroll = scroll.min(self.most);
            return Ok(Some(Key::Redraw));
        }
        Ok(None)
    }
}

/// Columns of the terminal, 80 if unknown.
pub fn columns() -> usize {
    size().map_or(80, |(columns, _)| usize::from(columns))
}

impl Drop for Screen {
    fn drop(&mut self) {
        // Silent, because the terminal is lost anyway.
        let _ = ratatui::try_restore();
    }
}
