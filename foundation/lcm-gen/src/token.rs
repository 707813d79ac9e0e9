//! Tokens and the comments around them.

use crate::{At, Error};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Token<'a> {
    /// Name, qualified name or number.
    Word(&'a str),
    /// One of `{ } [ ] ; , =`, or a character that has no meaning.
    Symbol(char),
    End,
}

#[derive(Debug)]
pub struct Spanned<'a> {
    pub token: Token<'a>,
    pub at: At,
    /// Block of comment lines before it.
    pub before: Vec<String>,
    /// Comment after it on the same line.
    pub after: Vec<String>,
}

/// Splits `text`; the last token is [`Token::End`].
pub fn tokens<'a>(file: &str, text: &'a str) -> Result<Vec<Spanned<'a>>, Error> {
    let mut cursor = Cursor { rest: text, at: At { line: 1, column: 1 } };
    if text.starts_with('\u{feff}') {
        let message = "the file begins with a byte order mark: save it as UTF-8 without one";
        return Err(Error::new(file, cursor.at, message));
    }
    let mut tokens: Vec<Spanned> = Vec::new();
    let (mut before, mut last_comment) = (Vec::new(), 0);
    loop {
        cursor.skip_while(char::is_whitespace);
        let at = cursor.at;
        if let Some(comment) = cursor.comment(file)? {
            match tokens.last_mut() {
                Some(previous) if previous.at.line == at.line => {
                    previous.after.extend(comment_lines(comment));
                }
                _ => {
                    if at.line > last_comment + 1 {
                        before.clear(); // a blank line separates remarks from documentation
                    }
                    before.extend(comment_lines(comment));
                    last_comment = cursor.at.line;
                }
            }
            continue;
        }
        let token = cursor.token();
        tokens.push(Spanned { token, at, before: std::mem::take(&mut before), after: Vec::new() });
        if token == Token::End {
            return Ok(tokens);
        }
    }
}

/// Text of a comment, without its slashes and asterisks.
fn comment_lines(comment: &str) -> Vec<String> {
    let frame = |c: char| c.is_whitespace() || c == '*' || c == '/';
    let mut lines: Vec<&str> = comment.lines().map(|line| line.trim_start_matches(frame).trim_end()).collect();
    if let Some(last) = lines.last_mut().filter(|_| comment.starts_with("/*")) {
        *last = last.trim_end_matches(frame);
    }
    let first = lines.iter().position(|line| !line.is_empty()).unwrap_or(lines.len());
    let end = lines.iter().rposition(|line| !line.is_empty()).map_or(first, |last| last + 1);
    lines[first..end].iter().map(|&line| line.to_owned()).collect()
}

struct Cursor<'a> {
    rest: &'a str,
    at: At,
}

impl<'a> Cursor<'a> {
    /// Takes the first `len` bytes.
    fn take(&mut self, len: usize) -> &'a str {
        let (taken, rest) = self.rest.split_at(len);
        for c in taken.chars() {
            if c == '\n' {
                self.at = At { line: self.at.line + 1, column: 1 };
            } else {
                self.at.column += 1;
            }
        }
        self.rest = rest;
        taken
    }

    fn skip_while(&mut self, skipped: impl Fn(char) -> bool) {
        self.take(self.rest.find(|c| !skipped(c)).unwrap_or(self.rest.len()));
    }

    fn comment(&mut self, file: &str) -> Result<Option<&'a str>, Error> {
        let len = if self.rest.starts_with("//") {
            self.rest.find('\n').unwrap_or(self.rest.len())
        } else if let Some(body) = self.rest.strip_prefix("/*") {
            let end = body.find("*/");
            end.ok_or_else(|| Error::new(file, self.at, "comment without end: expected `*/`"))? + 4
        } else {
            return Ok(None);
        };
        Ok(Some(self.take(len)))
    }

    fn token(&mut self) -> Token<'a> {
        match self.rest.chars().next() {
            None => Token::End,
            Some(c) if is_word(c) => {
                let word = self.word_len();
                Token::Word(self.take(word))
            }
            Some(c) => {
                self.take(c.len_utf8());
                Token::Symbol(c)
            }
        }
    }

    /// A plus sign belongs to a word only as the sign of an exponent: `1.5e+3`.
    fn word_len(&self) -> usize {
        let number = self.rest.starts_with(|c: char| c.is_ascii_digit() || c == '-' || c == '.' || c == '+');
        let mut previous = ' ';
        for (i, c) in self.rest.char_indices() {
            let exponent = number && matches!(previous, 'e' | 'E');
            if !(is_word(c) && (c != '+' || i == 0 || exponent)) {
                return i;
            }
            previous = c;
        }
        self.rest.len()
    }
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || matches!(c, '_' | '.' | '-' | '+')
}
