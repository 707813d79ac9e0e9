//! Finds decisions based on text for people: a program that compares a sentence breaks when the sentence is reworded.
//!
//! Searched are `reason`, `message` and `source`, as members, methods or variables made from them, that are compared
//! with a text or a constant, searched, split or matched. A check whether a text is empty or has changed is not such a
//! decision.

/// Members with text for people, or a name that one parser in `messages` reads.
const TEXTS: [&str; 3] = ["reason", "message", "source"];
/// Calls that return the same text.
const SAME: [&str; 13] = [
    "as_str",
    "as_deref",
    "as_ref",
    "clone",
    "cloned",
    "trim",
    "to_lowercase",
    "toLowerCase",
    "to_string",
    "to_owned",
    "unwrap_or_default",
    "borrow",
    "deref",
];
/// Calls that search or split a text.
const SEARCHES: [&str; 18] = [
    "contains",
    "starts_with",
    "ends_with",
    "strip_prefix",
    "strip_suffix",
    "find",
    "rfind",
    "split_once",
    "eq",
    "eq_ignore_ascii_case",
    "includes",
    "startsWith",
    "endsWith",
    "indexOf",
    "search",
    "match",
    "matches",
    "localeCompare",
];
/// Calls that search their argument.
const TESTS: [&str; 5] = ["contains", "includes", "test", "exec", "is_match"];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Language {
    Rust,
    TypeScript,
}

#[derive(Clone, Debug, PartialEq)]
enum Kind {
    Word,
    /// Literal without its quotes.
    Text,
    Sign,
}

#[derive(Clone, Debug)]
struct Token {
    kind: Kind,
    text: String,
    line: usize,
}

/// Lines with such decisions, each with an excerpt.
pub fn decisions(source: &str, language: Language) -> Vec<(usize, String)> {
    let tokens = tokens(source, language);
    let aliases = aliases(&tokens);
    let mut found: Vec<(usize, String)> = Vec::new();
    for at in 0..tokens.len() {
        if let Some(end) = text_ends(&tokens, at, &aliases)
            && decides(&tokens, at, end)
        {
            let from = begin(&tokens, at).saturating_sub(3);
            let excerpt: Vec<&str> =
                tokens[from..(end + 5).min(tokens.len())].iter().map(|t| t.text.as_str()).collect();
            found.push((tokens[at].line, excerpt.join(" ")));
        }
    }
    found.dedup_by_key(|(line, _)| *line);
    found
}

/// End of an expression whose value is such a text, if its name is at `at`: after the calls that return the same text.
fn text_ends(tokens: &[Token], at: usize, aliases: &[String]) -> Option<usize> {
    let token = &tokens[at];
    let is_member = at > 0 && [".", "?."].contains(&tokens[at - 1].text.as_str());
    let named = TEXTS.contains(&token.text.as_str()) || (!is_member && aliases.contains(&token.text));
    if token.kind != Kind::Word || !named {
        return None;
    }
    let mut end = at + 1;
    let sign = |at: usize, text: &str| tokens.get(at).is_some_and(|t| t.kind == Kind::Sign && t.text == text);
    loop {
        let next = tokens.get(end + 1);
        let is_call = sign(end, "(") && sign(end + 1, ")");
        let is_default = sign(end, "??") && next.is_some_and(|t| t.kind == Kind::Text);
        let hands_on = (sign(end, ".") || sign(end, "?.")) && next.is_some_and(|t| SAME.contains(&&*t.text));
        if is_call || is_default || hands_on {
            end += 2;
        } else if sign(end, ")") && is_grouped(tokens, at) {
            end += 1;
        } else {
            return Some(end);
        }
    }
}

/// True if the path to `at` follows a parenthesis that does not belong to a call.
fn is_grouped(tokens: &[Token], at: usize) -> bool {
    let Some(open) = begin(tokens, at).checked_sub(1).filter(|open| tokens[*open].text == "(") else { return false };
    open.checked_sub(1).is_none_or(|before| {
        tokens[before].kind == Kind::Sign && ![")", "]", "!", ">"].contains(&tokens[before].text.as_str())
    })
}

/// Beginning of the path before a member: `motion` for `motion.reason`.
fn begin(tokens: &[Token], mut at: usize) -> usize {
    while at >= 2 && [".", "?.", "::"].contains(&tokens[at - 1].text.as_str()) {
        at -= 2;
        while at > 0 && tokens[at].text == ")" {
            at = opening(tokens, at).saturating_sub(1);
        }
    }
    at
}

/// Opening sign of a closing one.
fn opening(tokens: &[Token], close: usize) -> usize {
    let mut depth = 0;
    for at in (0..=close).rev() {
        match tokens[at].text.as_str() {
            ")" => depth += 1,
            "(" => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return at;
        }
    }
    0
}

fn decides(tokens: &[Token], at: usize, end: usize) -> bool {
    let text = |at: usize| tokens.get(at).map_or("", |token| token.text.as_str());
    let first = begin(tokens, at);
    // x.reason.contains("…")
    if [".", "?."].contains(&text(end)) && SEARCHES.contains(&text(end + 1)) && text(end + 2) == "(" {
        return true;
    }
    // x.reason == "…"
    let skip = |at: usize| (at..at + 3).find(|at| !["&", "*"].contains(&text(*at))).unwrap_or(at);
    if is_comparison(text(end)) && is_fixed(tokens.get(skip(end + 1))) {
        return true;
    }
    // "…" == x.reason
    let before = (0..first).rev().find(|at| !["&", "*"].contains(&text(*at)));
    if let Some(before) = before.filter(|before| *before > 0)
        && is_comparison(text(before))
        && is_fixed(tokens.get(before - 1))
    {
        return true;
    }
    let Some(before) = before else { return false };
    // match x.reason { "…" => …, switch (x.reason) { case "…": …
    if text(before) == "match" {
        return !arms(&tokens[end.min(tokens.len())..]).is_empty();
    }
    if text(before) == "(" && before > 0 && text(before - 1) == "switch" {
        return tokens[end..].windows(2).take(60).any(|pair| pair[0].text == "case" && pair[1].kind == Kind::Text);
    }
    // ["…"].contains(&x.reason), /…/.test(x.reason), matches!(x.reason, "…")
    let called = if text(before) == "(" && before > 0 { text(before - 1) } else { "" };
    if called == "!" && before > 1 && text(before - 2) == "matches" {
        return tokens[end..].iter().take_while(|token| token.text != ")").any(|token| token.kind == Kind::Text);
    }
    TESTS.contains(&called) && [")", ","].contains(&text(end))
}

/// Non-empty literals and constants that are patterns of the `match` whose block begins `tokens`.
fn arms(tokens: &[Token]) -> Vec<&Token> {
    let (mut depth, mut in_pattern, mut patterns) = (0, true, Vec::new());
    for (at, token) in tokens.iter().enumerate().take(2000) {
        let sign = if token.kind == Kind::Sign { token.text.as_str() } else { "" };
        let before = at.checked_sub(1).map_or("", |before| tokens[before].text.as_str());
        match sign {
            "{" | "(" | "[" => depth += 1,
            "}" | ")" | "]" => {
                depth -= 1;
                // After the block of an arm.
                in_pattern |= depth == 1 && sign == "}";
            }
            "=>" if depth == 1 => in_pattern = false,
            "," if depth == 1 => in_pattern = true,
            _ if in_pattern && ["{", "}", ",", "|", "(", "@"].contains(&before) && is_fixed(Some(token)) => {
                patterns.push(token);
            }
            _ => {}
        }
        if depth == 0 {
            break;
        }
    }
    patterns
}

/// Literals that equal one of these sentences or a large part of it: such code either makes the sentence or searches
/// for it.
pub fn literals(source: &str, language: Language, sentences: &[&str]) -> Vec<(usize, String)> {
    const LEAST: usize = 17;
    let is_of = |literal: &str, sentence: &str| {
        let (head, tail) = sentence.split_once("{}").unwrap_or((sentence, ""));
        let is_part = literal.len() >= LEAST && (head.contains(literal) || tail.contains(literal));
        let is_whole = head.len() + tail.len() >= LEAST && literal.starts_with(head) && literal.ends_with(tail);
        is_part || (is_whole && literal.len() >= head.len() + tail.len())
    };
    let literals = tokens(source, language).into_iter().filter(|token| token.kind == Kind::Text);
    let found = literals.filter(|token| sentences.iter().any(|sentence| is_of(&token.text, sentence)));
    found.map(|token| (token.line, token.text)).collect()
}

fn is_comparison(sign: &str) -> bool {
    ["==", "!=", "===", "!=="].contains(&sign)
}

/// True for a non-empty literal or a constant.
fn is_fixed(token: Option<&Token>) -> bool {
    token.is_some_and(|token| match token.kind {
        Kind::Text => !token.text.is_empty(),
        Kind::Word => {
            let shouts = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
            token.text.len() > 1 && token.text.chars().all(shouts)
        }
        Kind::Sign => false,
    })
}

/// Variables made from one or several such texts only: `let why = &motion.reason;`.
fn aliases(tokens: &[Token]) -> Vec<String> {
    let mut names = Vec::new();
    for at in 0..tokens.len().saturating_sub(3) {
        let is_declared = ["let", "const"].contains(&&*tokens[at].text) && tokens[at + 1].kind == Kind::Word;
        if !is_declared || tokens[at + 2].text != "=" {
            continue;
        }
        let value = tokens[at + 3..].split(|token| token.text == ";").next().unwrap_or(&[]);
        let member =
            |pair: &[Token]| [".", "?."].contains(&&*pair[0].text) && ["reason", "message"].contains(&&*pair[1].text);
        let plain = !value.iter().any(|token| ["{", "|", "=>", "==", "!="].contains(&&*token.text));
        if plain && value.len() < 24 && value.windows(2).any(member) {
            names.push(tokens[at + 1].text.clone());
        }
    }
    names
}

/// Words, literals and signs, without comments.
fn tokens(source: &str, language: Language) -> Vec<Token> {
    let mut reader = Reader { left: source, line: 1, language, tokens: Vec::new() };
    while !reader.left.is_empty() {
        reader.next();
    }
    reader.tokens
}

struct Reader<'a> {
    left: &'a str,
    line: usize,
    language: Language,
    tokens: Vec<Token>,
}

impl Reader<'_> {
    fn next(&mut self) {
        let first = self.left.chars().next().unwrap_or(' ');
        match first {
            _ if self.left.starts_with("//") => self.skip(self.left.find('\n').unwrap_or(self.left.len())),
            _ if self.left.starts_with("/*") => self.skip(self.left.find("*/").map_or(self.left.len(), |end| end + 2)),
            '"' => self.literal(1, "\""),
            'r' if self.left.starts_with("r\"") => self.literal(2, "\""),
            'r' if self.left.starts_with("r#\"") => self.literal(3, "\"#"),
            '\'' if self.language == Language::TypeScript => self.literal(1, "'"),
            '\'' => self.quote(),
            '`' => self.template(),
            '/' if self.language == Language::TypeScript && self.may_begin_a_pattern() => self.pattern(),
            c if c.is_alphanumeric() || c == '_' => {
                let end = self.left.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(self.left.len());
                self.push(Kind::Word, end);
            }
            c if c.is_whitespace() => self.skip(c.len_utf8()),
            c => {
                let long = ["===", "!==", "==", "!=", "=>", "?.", "??", "::"];
                let sign = long.into_iter().find(|sign| self.left.starts_with(sign));
                self.push(Kind::Sign, sign.map_or(c.len_utf8(), str::len));
            }
        }
    }

    fn skip(&mut self, length: usize) {
        self.line += self.left[..length].matches('\n').count();
        self.left = &self.left[length..];
    }

    fn push(&mut self, kind: Kind, length: usize) {
        self.tokens.push(Token { kind, text: self.left[..length].into(), line: self.line });
        self.skip(length);
    }

    /// Literal whose text begins after `open` bytes.
    fn literal(&mut self, open: usize, close: &str) {
        let line = self.line;
        self.skip(open);
        let end = self.unescaped(close, open == 1);
        self.tokens.push(Token { kind: Kind::Text, text: self.left[..end].into(), line });
        self.skip((end + close.len()).min(self.left.len()));
    }

    fn unescaped(&self, close: &str, escapes: bool) -> usize {
        let mut at = 0;
        while at < self.left.len() && !self.left[at..].starts_with(close) {
            let is_escape = escapes && self.left[at..].starts_with('\\');
            let mut chars = self.left[at..].chars();
            let width = |c: Option<char>| c.map_or(0, char::len_utf8);
            at += width(chars.next()) + if is_escape { width(chars.next()) } else { 0 };
        }
        at.min(self.left.len())
    }

    /// Character or lifetime.
    fn quote(&mut self) {
        let mut chars = self.left.chars().skip(1);
        let (first, second) = (chars.next(), chars.next());
        match (first, second) {
            (Some('\\'), _) => self.literal(1, "'"),
            (Some(_), Some('\'')) => self.literal(1, "'"),
            _ => self.skip(1),
        }
    }

    /// Template literal of TypeScript: its texts and the expressions in its placeholders.
    fn template(&mut self) {
        self.skip(1);
        while !self.left.is_empty() {
            let (end, hole) = (self.unescaped("`", true), self.unescaped("${", true));
            if end < hole {
                self.push(Kind::Text, end);
                return self.skip(1);
            }
            self.push(Kind::Text, hole);
            self.skip(2.min(self.left.len()));
            let mut depth = 1;
            while depth > 0 && !self.left.is_empty() {
                depth += i32::from(self.left.starts_with('{')) - i32::from(self.left.starts_with('}'));
                if depth > 0 { self.next() } else { self.skip(1) }
            }
        }
    }

    fn may_begin_a_pattern(&self) -> bool {
        let before = self.tokens.last();
        before.is_none_or(|token| token.kind == Kind::Sign && !")]}".contains(token.text.as_str()))
    }

    fn pattern(&mut self) {
        self.literal(1, "/");
        if let Some(last) = self.tokens.last_mut() {
            last.text.insert(0, '/');
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finds(source: &str, language: Language) -> bool {
        !decisions(source, language).is_empty()
    }

    #[test]
    fn decisions_by_text_are_found() {
        for planted in [
            r#"if motion.reason == "nobody commands the motion" {}"#,
            r#"let idle = motion.homed && motion.reason == IDLE;"#,
            r#"if "nobody" != motion.reason {}"#,
            r#"let free = ["", "nobody commands the motion"].contains(&motion.reason.as_str());"#,
            r#"let failed = |motion: &DataMotion| motion.reason.starts_with("homing the steering failed");"#,
            r#"if motion
                .reason
                .contains(LATCHED) {}"#,
            r#"match motion.reason.as_str() { "" if drives => None, NOBODY => Some(1), _ => None }"#,
            r#"let number: u32 = stop.source.strip_prefix("bumper")?.parse().ok()?;"#,
            r#"match motion.reason.as_str() { "" if drives => { x(); } reason @ "waits" => 1, _ => 2 }"#,
            r#"matches!(goal.message.as_str(), "begins" | "looks for a way")"#,
            r#"let why = motion.reason.clone(); if why.contains("PAUSE") {}"#,
            r#"view.reason().contains("PAUSE")"#,
            r#"fn f(DataMotion { reason, .. }: &DataMotion) -> bool { reason == "x" }"#,
            r#"stop.source == "button""#,
            r##"goal.message.starts_with(r#"waits for an operator"#)"##,
        ] {
            assert!(finds(planted, Language::Rust), "{planted}");
        }
        for planted in [
            r#"return HELD.test(motion.reason);"#,
            r#"if (/must be let go by an operator/.test(robot.bus.motion()?.reason ?? "")) return;"#,
            r#"const waits = `${reason} ${part.goal.value?.message ?? ""}`; if (/waits for an operator/.test(waits)) go();"#,
            r#"const bumper = /^bumper([1-8])$/.exec(line.source);"#,
            r#"if (line.source === "button") turn();"#,
            r#"switch (motion.reason) { case "x": return 1; }"#,
            r#"motion.reason.startsWith("homing")"#,
            r#"goal.message.includes('waits')"#,
            r#"const is = !x && (goal?.message ?? "").includes("waits");"#,
        ] {
            assert!(finds(planted, Language::TypeScript), "{planted}");
        }
    }

    #[test]
    fn sentences_in_the_code_are_found() {
        let sentences = ["nobody commands the motion", "critical module {} is not running", "{} is down"];
        for (planted, found) in [
            (r#"const IDLE: &str = "nobody commands the motion";"#, true),
            (r#"if what == "critical module x is not running" {}"#, true),
            (r#"if what.contains("commands the motion") {}"#, true),
            (r#"format!("a critical module does not run since {since:?}")"#, false),
            (r#"/// "nobody commands the motion""#, false),
            (r#"write!(f, "{name} is down")"#, false),
        ] {
            assert_eq!(!literals(planted, Language::Rust, &sentences).is_empty(), found, "{planted}");
        }
    }

    #[test]
    fn display_and_change_detection_are_not_found() {
        for fine in [
            r#"if motion.reason.is_empty() { "the drives are not ready" } else { &motion.reason }"#,
            r#"if self.told != reason { self.told = reason.into(); }"#,
            r#"(last.status, &last.message) != (goal.status, &goal.message)"#,
            r#"if command.source == *name && motion.source != source {}"#,
            r#"match message { Message::LlDataMotion(motion) => 1, _ => "x" }"#,
            r#"match motion.source.as_str() { "" => text.to_owned(), source => format!("{text}; {source} commands") }"#,
            r#"if matches!(reason, LostReason::BootUp | LostReason::Reboot) || seen.contains(&message.channel()) {}"#,
            r#"match reason { BootError::Mismatch { .. } => 1, _ => 2 }"#,
            r#"// motion.reason == "x""#,
            r#"let text = "motion.reason == IDLE"; let c = '"'; let s: &'a str = text;"#,
            r#"let message = format!("{} is down", motion.reason); out.raise(message.as_str());"#,
            r#"let short = motion.source.is_empty() || motion.reason != "";"#,
        ] {
            assert_eq!(decisions(fine, Language::Rust), [], "{fine}");
        }
        for fine in [
            r#"const why = motion.reason || "The steering does not know where straight ahead is.";"#,
            r#"return { word, reason: part.status.reason };"#,
            r#"const spoken = reason.replace(/[0-9.]+ (s|m\/s)\b/g, "");"#,
            r#"const x = a / b; const y = `${group.message} ${c / d}`;"#,
            r#"if (goal.message) return sentence(goal.message);"#,
        ] {
            assert_eq!(decisions(fine, Language::TypeScript), [], "{fine}");
        }
    }
}
