//! The page: one file that needs no other.

use super::{Block, Report, Shown};
use crate::draw::{dark_style, escaped};

const STYLE: &str = "\
:root{color-scheme:light dark}
body{font:15px/1.5 Ubuntu,Helvetica Neue,Arial,Liberation Sans,sans-serif;max-width:1240px;margin:2em auto;\
padding:0 1em;color:#1c1e21;background:#fff}
h1{font-size:1.6em}h2{font-size:1.25em;margin:2em 0 .4em}h3{font-size:1.05em;margin:1.6em 0 .3em}
svg{max-width:100%;height:auto;display:block}p,figure,.caption{max-width:940px}
figure{margin:1.5em 0}figcaption,.caption{color:#5c6166;font-size:.86em;line-height:1.45;margin:.3em 0}
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:.86em}
th{text-align:left;padding-right:.8em;font-weight:600;border-bottom:1px solid #5c6166}
th,td{padding:.25em .8em .25em 0;vertical-align:top}td{border-bottom:1px solid #e3e5e8}
.number{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
summary{cursor:pointer}
";
const DARK_STYLE: &str = "\
body{color:#ecedee;background:#17191c}figcaption,.caption{color:#a4a9ae}
th{border-color:#a4a9ae}td{border-color:#3a3e43}
";

/// The whole page.
pub(super) fn page(report: &Report) -> String {
    let title = escaped(&report.title);
    let mut body = format!("<h1>{title}</h1>\n");
    for block in &report.blocks {
        body.push_str(&match block {
            Block::Heading(text) => format!("<h2>{}</h2>\n", escaped(text)),
            Block::Text(text) => format!("<p>{}</p>\n", escaped(text)),
            Block::Figure(figure) => format!(
                "<figure>\n<h3>{}</h3>\n{}\n<figcaption>{}</figcaption>\n</figure>\n",
                escaped(&figure.title),
                figure.drawing().svg(&figure.title),
                escaped(&figure.caption)
            ),
            Block::Table(table) if table.shown == Shown::File => String::new(),
            Block::Table(table) => {
                let (title, caption) = (escaped(&table.title), escaped(&table.caption));
                let content = format!("<p class=\"caption\">{caption}</p>\n{}", table.html());
                if table.shown == Shown::Folded {
                    format!("<details><summary>{title}</summary>\n{content}\n</details>\n")
                } else {
                    format!("<h3>{title}</h3>\n{content}\n")
                }
            }
        });
    }
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{title}</title>\n<style>\n{STYLE}@media (prefers-color-scheme: dark){{\n{DARK_STYLE}{}\n}}\n\
         </style>\n</head>\n<body>\n{body}</body>\n</html>\n",
        dark_style()
    )
}
