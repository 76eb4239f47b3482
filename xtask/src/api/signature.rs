//! Items as lines of text: names and types, without bodies, attributes and descriptions.

use syn::{
    Attribute, Fields, FnArg, ImplItem, Item, ItemEnum, ItemImpl, ItemStruct, ItemTrait, Pat, Signature, Token,
    TraitItem, Type, Variant,
};

use crate::sources::is_public;

/// Lines of an item and of its public parts, each after its path. `path` is the item's, whatever it is called in its
/// own crate.
pub fn of_item(item: &Item, path: &str) -> Vec<(String, String)> {
    let whole = |text: String| vec![(path.to_owned(), text)];
    match item {
        Item::Const(item) => whole(format!("pub const {path}: {}", of_type(&item.ty))),
        Item::Static(item) => whole(format!("pub static {path}: {}", of_type(&item.ty))),
        Item::Fn(item) => whole(format!("pub {}", of_function(&item.sig, path))),
        Item::Struct(item) => of_struct(item, path),
        Item::Enum(item) => of_enum(item, path),
        Item::Trait(item) => of_trait(item, path),
        Item::Type(item) => {
            let mut item = item.clone();
            item.attrs.clear();
            whole(renamed(&one_line(Item::Type(item.clone())), "type", &item.ident, path))
        }
        other => {
            let mut item = other.clone();
            match &mut item {
                Item::TraitAlias(item) => item.attrs.clear(),
                Item::Union(item) => item.attrs.clear(),
                _ => {}
            }
            whole(format!("{} as {path}", one_line(item)))
        }
    }
}

/// Lines of the public functions, constants and types that `impl Type { .. }` gives the type at `path`.
pub fn of_implementation(implementation: &ItemImpl, path: &str) -> Vec<(String, String)> {
    // what bounds its functions have, and of which of the type's instances they are
    let origin = match &*implementation.self_ty {
        Type::Path(of) if of.path.segments.iter().all(|segment| segment.arguments.is_none()) => String::new(),
        _ => {
            let mut header = implementation.clone();
            header.attrs.clear();
            header.items.clear();
            format!(", in {}", without_body(&one_line(Item::Impl(header))))
        }
    };
    let mut lines = Vec::new();
    for item in &implementation.items {
        let (name, text) = match item {
            ImplItem::Fn(item) if is_public(&item.vis) => {
                let path = format!("{path}::{}", item.sig.ident);
                (&item.sig.ident, format!("pub {}", of_function(&item.sig, &path)))
            }
            ImplItem::Const(item) if is_public(&item.vis) => {
                (&item.ident, format!("pub const {path}::{}: {}", item.ident, of_type(&item.ty)))
            }
            _ => continue,
        };
        lines.push((format!("{path}::{name}"), text + &origin));
    }
    lines
}

/// What an item is called where it is written.
pub fn name(item: &Item) -> String {
    match item {
        Item::Enum(item) => item.ident.to_string(),
        Item::Struct(item) => item.ident.to_string(),
        Item::Trait(item) => item.ident.to_string(),
        Item::Type(item) => item.ident.to_string(),
        _ => "_".to_owned(),
    }
}

fn of_struct(item: &ItemStruct, path: &str) -> Vec<(String, String)> {
    let header = ItemStruct {
        attrs: Vec::new(),
        fields: Fields::Unit,
        semi_token: Some(<Token![;]>::default()),
        ..item.clone()
    };
    let mut text = renamed(&one_line(Item::Struct(header)), "struct", &item.ident, path);
    let mut lines = Vec::new();
    match &item.fields {
        Fields::Named(fields) => {
            if fields.named.iter().any(|field| !is_public(&field.vis)) {
                text.push_str(" { .. }");
            }
            for field in fields.named.iter().filter(|field| is_public(&field.vis)) {
                let path = format!("{path}::{}", field.ident.as_ref().map(ToString::to_string).unwrap_or_default());
                lines.push((path.clone(), format!("pub {path}: {}", of_type(&field.ty))));
            }
        }
        Fields::Unnamed(fields) => {
            let shown = |field: &syn::Field| match is_public(&field.vis) {
                true => format!("pub {}", of_type(&field.ty)),
                false => "_".to_owned(),
            };
            text.push_str(&format!("({})", fields.unnamed.iter().map(shown).collect::<Vec<_>>().join(", ")));
        }
        Fields::Unit => {}
    }
    lines.insert(0, (path.to_owned(), openness(&item.attrs) + &text));
    lines
}

fn of_enum(item: &ItemEnum, path: &str) -> Vec<(String, String)> {
    let mut header = item.clone();
    header.attrs.clear();
    header.variants.clear();
    let text = renamed(without_body(&one_line(Item::Enum(header))), "enum", &item.ident, path);
    let mut lines = vec![(path.to_owned(), openness(&item.attrs) + &text)];
    for variant in &item.variants {
        let path = format!("{path}::{}", variant.ident);
        lines.push((path.clone(), openness(&variant.attrs) + &of_variant(variant, &path)));
    }
    lines
}

fn of_variant(variant: &Variant, path: &str) -> String {
    let fields = variant.fields.iter().map(|field| match &field.ident {
        Some(name) => format!("{name}: {}", of_type(&field.ty)),
        None => of_type(&field.ty),
    });
    let fields = fields.collect::<Vec<_>>().join(", ");
    match &variant.fields {
        Fields::Named(_) => format!("{path} {{ {fields} }}"),
        Fields::Unnamed(_) => format!("{path}({fields})"),
        Fields::Unit => path.to_owned(),
    }
}

fn of_trait(item: &ItemTrait, path: &str) -> Vec<(String, String)> {
    let header = ItemTrait { attrs: Vec::new(), items: Vec::new(), ..item.clone() };
    let text = renamed(without_body(&one_line(Item::Trait(header))), "trait", &item.ident, path);
    let mut lines = vec![(path.to_owned(), text)];
    for part in &item.items {
        let (name, text) = match part {
            TraitItem::Fn(function) => {
                let text = of_function(&function.sig, &format!("{path}::{}", function.sig.ident));
                (&function.sig.ident, if function.default.is_some() { text + " { .. }" } else { text })
            }
            TraitItem::Const(constant) => {
                (&constant.ident, format!("const {path}::{}: {}", constant.ident, of_type(&constant.ty)))
            }
            TraitItem::Type(of) => {
                let mut of = of.clone();
                of.attrs.clear();
                let alone = one_line(syn::parse_quote!(trait T { #of }));
                let text = alone.trim_start_matches("trait T { ").trim_end_matches("; }");
                (&of.ident.clone(), renamed(text, "type", &of.ident, &format!("{path}::{}", of.ident)))
            }
            _ => continue,
        };
        lines.push((format!("{path}::{name}"), text));
    }
    lines
}

fn without_body(line: &str) -> &str {
    line.trim_end_matches(" {}").trim_end_matches(',')
}

/// `fn path(argument: Type) -> Type`, with what stands before and after it.
fn of_function(signature: &Signature, path: &str) -> String {
    let mut signature = signature.clone();
    for argument in &mut signature.inputs {
        // that a function changes its own copy of an argument is nobody else's business
        if let FnArg::Typed(argument) = argument {
            argument.attrs.clear();
            if let Pat::Ident(name) = &mut *argument.pat {
                name.mutability = None;
            }
        }
    }
    let name = signature.ident.clone();
    let function = syn::parse_quote!(#signature {});
    renamed(without_body(&one_line(Item::Fn(function))), "fn", &name, path)
}

fn of_type(of: &Type) -> String {
    let alias = syn::parse_quote!(type T = #of;);
    one_line(Item::Type(alias)).trim_start_matches("type T = ").to_owned()
}

/// Whether others must expect more fields or variants.
fn openness(attributes: &[Attribute]) -> String {
    let is_open = attributes.iter().any(|attribute| attribute.path().is_ident("non_exhaustive"));
    if is_open { "#[non_exhaustive] ".to_owned() } else { String::new() }
}

/// With the path of an item in place of its name.
fn renamed(line: &str, keyword: &str, name: &syn::Ident, path: &str) -> String {
    line.replacen(&format!("{keyword} {name}"), &format!("{keyword} {path}"), 1)
}

/// As rustfmt would write it if lines had no end.
fn one_line(item: Item) -> String {
    let text =
        prettyplease::unparse(&syn::File { shebang: None, frontmatter: None, attrs: Vec::new(), items: vec![item] });
    let mut line = String::new();
    for part in text.lines().map(str::trim).filter(|part| !part.is_empty()) {
        let opens = line.is_empty() || line.ends_with(['(', '[', '<']);
        let closes = part.starts_with([')', ']', '>']);
        if closes {
            line.truncate(line.trim_end_matches(',').len());
        } else if !opens {
            line.push(' ');
        }
        line.push_str(part);
    }
    line.trim_end_matches(';').trim_end_matches(',').to_owned()
}
