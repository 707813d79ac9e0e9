//! Parser of one file.

use crate::ast::qualified;
use crate::token::{Spanned, Token, tokens};
use crate::{At, Constant, Definition, Dim, Error, Kind, Literal, Member, MemberType, Primitive, Size, Value};

/// Content of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct File {
    /// Comment before each `package`, with the package's name; in a file with a single type it belongs to the type.
    pub packages: Vec<(String, Vec<String>)>,
    /// Structs and enums, in order.
    pub definitions: Vec<Definition>,
}

/// Parses the text of a file; `name` is for messages only.
///
/// Grammar: `docs/content/lcm-type-ref.md` and `lcmgen/lcmgen.c` of LCM 1.5.
///
/// # Errors
/// The first error.
pub fn parse(name: &str, text: &str) -> Result<File, Error> {
    let tokens = tokens(name, text)?;
    let mut parser = Parser { file: name, tokens, next: 0, package: String::new() };
    let mut file = File::default();
    loop {
        let doc = parser.peek().before.clone();
        match parser.peek().token {
            Token::End => break,
            Token::Word("package") => {
                parser.package()?;
                file.packages.push((parser.package.clone(), doc));
            }
            Token::Word("struct") => file.definitions.push(parser.definition(doc, Parser::structure)?),
            Token::Word("enum") => file.definitions.push(parser.definition(doc, Parser::enumeration)?),
            _ => return Err(parser.unexpected("`package`, `struct` or `enum`")),
        }
    }
    if let ([(_, about)], [only]) = (&mut file.packages[..], &mut file.definitions[..]) {
        let parted = !about.is_empty() && !only.doc.is_empty();
        let doc = std::mem::take(&mut only.doc);
        only.doc.extend(about.drain(..).chain(parted.then(String::new)).chain(doc));
    }
    Ok(file)
}

struct Parser<'a> {
    file: &'a str,
    tokens: Vec<Spanned<'a>>,
    next: usize,
    package: String,
}

impl<'a> Parser<'a> {
    fn peek(&self) -> &Spanned<'a> {
        &self.tokens[self.next.min(self.tokens.len() - 1)]
    }

    fn at(&self) -> At {
        self.peek().at
    }

    fn error(&self, at: At, message: impl Into<String>) -> Error {
        Error::new(self.file, at, message)
    }

    fn unexpected(&self, expected: &str) -> Error {
        let found = match self.peek().token {
            Token::Word(word) => format!("`{word}`"),
            Token::Symbol(quote @ ('"' | '\'')) => format!("`{quote}`"),
            Token::Symbol(symbol) => format!("`{}`", symbol.escape_debug()),
            Token::End => "the end of the file".to_owned(),
        };
        self.error(self.at(), format!("expected {expected}, found {found}"))
    }

    /// Takes the next token if it is `symbol`.
    fn eat(&mut self, symbol: char) -> bool {
        let found = self.peek().token == Token::Symbol(symbol);
        self.next += usize::from(found);
        found
    }

    fn expect(&mut self, symbol: char, after: &str) -> Result<(), Error> {
        if self.eat(symbol) { Ok(()) } else { Err(self.unexpected(&format!("`{symbol}` after {after}"))) }
    }

    fn word(&mut self, expected: &str) -> Result<&'a str, Error> {
        match self.peek().token {
            Token::Word(word) => {
                self.next += 1;
                Ok(word)
            }
            _ => Err(self.unexpected(expected)),
        }
    }

    fn name(&mut self, expected: &str) -> Result<&'a str, Error> {
        let at = self.at();
        let word = self.word(expected)?;
        if is_name(word) {
            Ok(word)
        } else {
            Err(self.error(at, format!("expected {expected}, found `{word}`: a name is letters, digits and `_`")))
        }
    }

    fn qualified_name(&mut self, expected: &str) -> Result<&'a str, Error> {
        let at = self.at();
        let word = self.word(expected)?;
        if word.split('.').all(is_name) {
            Ok(word)
        } else {
            Err(self.error(at, format!("expected {expected}, found `{word}`: a name is letters, digits and `_`")))
        }
    }

    fn package(&mut self) -> Result<(), Error> {
        self.next += 1;
        self.package = self.qualified_name("a package name")?.to_owned();
        self.expect(';', "the package name")
    }

    fn definition(
        &mut self,
        mut doc: Vec<String>,
        body: fn(&mut Self, &str) -> Result<Kind, Error>,
    ) -> Result<Definition, Error> {
        self.next += 1;
        let at = self.at();
        let short = self.name("the name of a type")?.to_owned();
        if Primitive::from_name(&short).is_some() {
            return Err(self.error(at, format!("`{short}` is a type of the language and cannot be defined")));
        }
        if doc.is_empty() {
            doc = self.peek().after.clone();
        }
        self.expect('{', "the name of a type")?;
        let kind = body(self, &short)?;
        Ok(Definition { package: self.package.clone(), short, doc, kind, file: self.file.to_owned(), at })
    }

    fn structure(&mut self, _short: &str) -> Result<Kind, Error> {
        let (mut constants, mut members) = (Vec::new(), Vec::new());
        loop {
            match self.peek().token {
                Token::Symbol('}') => break,
                Token::Word("const") => self.constants(&mut constants, &members)?,
                Token::Word("struct" | "enum" | "union") => {
                    return Err(self.error(self.at(), "types cannot be defined inside a struct"));
                }
                Token::Word(_) => self.members(&constants, &mut members)?,
                _ => return Err(self.unexpected("a member, `const` or `}`")),
            }
        }
        self.next += 1;
        if self.peek().token == Token::Symbol(';') {
            return Err(self.error(self.at(), "no `;` may follow the `}` of a struct"));
        }
        Ok(Kind::Struct { constants, members })
    }

    /// Takes the `;` of a declaration; a comment after it documents the declaration unless one precedes it.
    fn semicolon(&mut self, after: &str, doc: Vec<String>) -> Result<Vec<String>, Error> {
        let trailing = self.peek().after.clone();
        self.expect(';', after)?;
        Ok(if doc.is_empty() { trailing } else { doc })
    }

    fn fresh(&self, at: At, name: &str, constants: &[Constant], members: &[Member]) -> Result<(), Error> {
        let known = constants.iter().any(|c| c.name == name) || members.iter().any(|m| m.name == name);
        if known { Err(self.error(at, format!("`{name}` is declared twice"))) } else { Ok(()) }
    }

    fn constants(&mut self, constants: &mut Vec<Constant>, members: &[Member]) -> Result<(), Error> {
        let doc = self.peek().before.clone();
        self.next += 1;
        let at = self.at();
        let word = self.word("the type of a constant")?;
        let ty = Primitive::from_name(word)
            .filter(|ty| ty.integer_bits().is_some() || matches!(ty, Primitive::Float | Primitive::Double))
            .ok_or_else(|| {
                self.error(at, format!("a constant cannot be of type `{word}`, only integer, float, double"))
            })?;
        let first = constants.len();
        loop {
            let at = self.at();
            let name = self.name("the name of a constant")?.to_owned();
            self.fresh(at, &name, constants, members)?;
            self.expect('=', "the name of a constant")?;
            let at = self.at();
            let text = self.word("the value of a constant")?.to_owned();
            let literal = literal(ty, &text).map_err(|message| self.error(at, message))?;
            constants.push(Constant { name, ty, text, literal, doc: Vec::new() });
            if !self.eat(',') {
                break;
            }
        }
        let doc = self.semicolon("the value of a constant", doc)?;
        constants[first..].iter_mut().for_each(|constant| constant.doc.clone_from(&doc));
        Ok(())
    }

    fn members(&mut self, constants: &[Constant], members: &mut Vec<Member>) -> Result<(), Error> {
        let (at, doc) = (self.at(), self.peek().before.clone());
        let word = self.qualified_name("the type of a member")?;
        let ty = match Primitive::from_name(word) {
            Some(primitive) => MemberType::Primitive(primitive),
            None if word.contains('.') => MemberType::Named(word.to_owned()),
            None => MemberType::Named(qualified(&self.package, word)),
        };
        let first = members.len();
        loop {
            let name_at = self.at();
            let name = self.name("the name of a member")?.to_owned();
            self.fresh(name_at, &name, constants, members)?;
            let mut dims = Vec::new();
            while self.eat('[') {
                dims.push(self.dimension(constants, members)?);
                self.expect(']', "an array dimension")?;
            }
            members.push(Member { name, ty: ty.clone(), dims, doc: Vec::new(), at });
            if !self.eat(',') {
                break;
            }
        }
        let doc = self.semicolon("the name of a member", doc)?;
        members[first..].iter_mut().for_each(|member| member.doc.clone_from(&doc));
        Ok(())
    }

    fn dimension(&mut self, constants: &[Constant], members: &[Member]) -> Result<Dim, Error> {
        let at = self.at();
        let word = self.word("an array dimension")?;
        let constant = constants.iter().find(|constant| constant.name == word);
        let text = constant.map_or(word, |constant| &constant.text);
        if constant.is_some_and(|constant| matches!(constant.literal, Literal::Float(_))) {
            return Err(self.error(at, format!("`{word}` is not an integer constant and cannot be an array dimension")));
        }
        if constant.is_some() || !is_name(word) {
            // A dimension beyond 32 bits is too large for a message, too.
            let size = integer(text).filter(|&size| size > 0).map(|size| usize::try_from(size).unwrap_or(usize::MAX));
            let wrong = || self.error(at, format!("an array dimension must be an integer above 0, not `{text}`"));
            return Ok(Dim { size: Size::Fixed(size.ok_or_else(wrong)?), text: text.to_owned() });
        }
        let length = members.iter().find(|member| member.name == word);
        match length {
            Some(Member { ty: MemberType::Primitive(ty), dims, .. })
                if ty.integer_bits().is_some() && dims.is_empty() =>
            {
                Ok(Dim { size: Size::Variable, text: word.to_owned() })
            }
            Some(_) => {
                Err(self.error(at, format!("`{word}` is not a scalar integer and cannot be an array dimension")))
            }
            None => Err(self.error(at, format!("`{word}` is not a constant or member declared before"))),
        }
    }

    fn enumeration(&mut self, _short: &str) -> Result<Kind, Error> {
        let mut values: Vec<Value> = Vec::new();
        while !self.eat('}') {
            let (at, doc) = (self.at(), self.peek().before.clone());
            let name = self.name("the name of an enum value")?.to_owned();
            if values.iter().any(|value| value.name == name) {
                return Err(self.error(at, format!("`{name}` is declared twice")));
            }
            let number = if self.eat('=') {
                let at = self.at();
                let text = self.word("the value of an enum value")?;
                let number = integer(text).and_then(|number| i32::try_from(number).ok());
                number.ok_or_else(|| self.error(at, format!("`{text}` is not a 32-bit integer")))?
            } else {
                // lcmgen.c: the largest value so far, at least 0, plus 1.
                let largest = values.iter().map(|value| value.number).max().unwrap_or(0).max(0);
                largest.checked_add(1).ok_or_else(|| self.error(at, "the value is above 32 bits"))?
            };
            // As the official tool.
            if let Some(same) = values.iter().find(|value| value.number == number) {
                return Err(self.error(at, format!("`{name}` and `{}` have the same value {number}", same.name)));
            }
            values.push(Value { name, number, doc });
            let _separated = self.eat(',') || self.eat(';');
        }
        Ok(Kind::Enum { values })
    }
}

fn is_name(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

/// Integer by the rules of C: `0x` is hexadecimal, a leading 0 octal.
fn integer(text: &str) -> Option<i128> {
    let (negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let (digits, radix) = match digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X")) {
        Some(hex) => (hex, 16),
        None if digits.len() > 1 && digits.starts_with('0') => (&digits[1..], 8),
        None => (digits, 10),
    };
    let unsigned = digits.starts_with(|c: char| c.is_digit(radix));
    let magnitude = i128::from_str_radix(digits, radix).ok().filter(|_| unsigned)?;
    Some(if negative { -magnitude } else { magnitude })
}

fn literal(ty: Primitive, text: &str) -> Result<Literal, String> {
    let out_of_range = || format!("`{text}` is out of the range of {}", ty.name());
    if let Some(bits) = ty.integer_bits() {
        let value = integer(text).ok_or_else(|| format!("`{text}` is not an integer"))?;
        let limit = 1_i128 << (bits - 1);
        let fits = (-limit..limit).contains(&value);
        return i64::try_from(value).ok().filter(|_| fits).map(Literal::Int).ok_or_else(out_of_range);
    }
    let digits = text.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c));
    let value: f64 = text.parse().ok().filter(|_| digits).ok_or_else(|| format!("`{text}` is not a decimal number"))?;
    let max = if ty == Primitive::Float { f64::from(f32::MAX) } else { f64::MAX };
    if value.abs() <= max { Ok(Literal::Float(value)) } else { Err(out_of_range()) }
}
